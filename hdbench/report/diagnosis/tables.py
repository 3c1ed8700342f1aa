"""Tables of a diagnosis: causes, places without a name, and what could have been missed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.report import inspection
from hdbench.report.diagnosis.limits import hidden_names
from hdbench.report.numbers import (
    DASH,
    fixed,
    name_words,
    plain,
    probability,
    stated,
    unit_of,
    unit_words,
    value_of,
)
from hdbench.report.pagemodel import Column, Table

Result = Mapping[str, Any]


def tables(result: Result) -> tuple[Table, ...]:
    """List causes, unexplained places, what could have been missed and what cannot show."""
    columns: tuple[Column, ...] = (
        ("cause", _names),
        ("parameters", lambda cause: _sizes(cause.get("parameters", {}))),
        ("what speaks for it", _evidence),
    )
    layout: Any = {"wide": True, "stacked": True}
    found = Table.filled(
        Table.of("Causes", columns, result.get("causes", ()), **layout),
        Table.of("Smaller causes", columns, result.get("minor", ()), **layout),
        _records_of_causes(result),
        Table.of(
            "Records",
            (
                ("record", "record", str),
                (
                    "held-out, simulation (N·m)",
                    lambda r: value_of(r, "simulated", "heldout_rms_nm"),
                ),
                ("held-out, extended (N·m)", lambda r: value_of(r, "extended", "heldout_rms_nm")),
                ("remark", _remark),
            ),
            result.get("records", ()),
            **layout,
        ),
        Table.of(
            "Unexplained",
            (("axis", _axes), ("place", _place), ("size", _size)),
            result.get("unexplained", ()),
            stacked=True,
        ),
        Table.of(
            "Smallest effect this record would have shown",
            (("cause", "name"), ("amplitude (N·m)", lambda one: one.get("amplitude_nm"))),
            result.get("minimum_detectable", ()),
        ),
        _testable(result),
    )
    inspected = result.get("inspection")
    return (*found, *(inspection.tables(inspected) if inspected else ()))


def _names(cause: Result) -> str:
    alike = dict.fromkeys((*cause.get("group", ()), *cause.get("rivals", ())))
    return "\n".join((cause["name"], *(f"or {x}" for x in alike if x != cause["name"])))


def _sizes(parameters: Result) -> str:
    """Return one parameter a line."""
    return "\n".join(
        f"{name_words(key)}: {plain(parameters[key])} {unit_words(unit_of(parameters[key]))}"
        for key in stated(parameters)
    )


def _evidence(cause: Result) -> str:
    words = [_explained(cause), f"false alarm {probability(cause.get('false_alarm_probability'))}"]
    if cause.get("separating_experiment"):
        words.append(f"told apart by: {cause['separating_experiment']}")
    return "\n".join(words)


def _explained(cause: Result) -> str:
    return f"explains {_share((cause.get('gain') or {}).get('explained_fraction'))}"


def _share(value: float | None) -> str:
    return DASH if value is None else f"{fixed(100.0 * value, 1)} %"


def _records_of_causes(result: Result) -> Table:
    """List what each of several records says of each cause; no rows for one record."""

    def says(row: tuple[str, Result]) -> str:
        one = row[1]
        words = (f"{one['evidence_nats']:.1f} nats", _explained(one))
        return "\n".join((*words, "disagrees") if one["disagrees"] else words)

    columns: tuple[Column, ...] = (
        ("cause", lambda row: row[0]),
        ("record", lambda row: row[1]["record"]),
        ("what it says", says),
        ("size in it alone", lambda row: _sizes(row[1]["parameters"]) or DASH),
    )
    rows = [
        (cause["name"], one)
        for cause in (*result.get("causes", ()), *result.get("minor", ()))
        for one in cause.get("records", ())
    ]
    note = (
        "By how much the likelihood of each record falls without the cause, and the size of the "
        "cause as that record alone has it, beside all that the records share."
    )
    title = "Which record speaks for which cause"
    return Table.of(title, columns, rows, note, wide=True, stacked=True)


def _remark(record: Result) -> str:
    if record["disagrees"]:
        return f"disagrees about {', '.join(dict.fromkeys(record['disagrees']))}"
    return f"left out: {record['left_out']}" if record["left_out"] else DASH


def _axes(place: Result) -> str:
    second = place.get("second_domain")
    return f"{place.get('domain')}\nwith {second}" if second else str(place.get("domain"))


def _place(place: Result) -> str:
    unit = "" if place.get("unit") in (None, "1") else f" {place['unit']}"
    low, high = place.get("extent") or (None, None)
    return f"{plain(place.get('location'))}{unit}\n{plain(low)} to {plain(high)}{unit}"


def _size(place: Result) -> str:
    share = _share(place.get("share_of_variance"))
    return f"{plain(place.get('size_nm'))} N·m\n{share} of the variance"


def _testable(result: Result) -> Table:
    """List by reason which names of the catalogue this record can show."""
    told = result.get("testable") or ()
    seen: dict[str, list[str]] = {}
    for one in told:
        if one["testable"]:
            words = f"in part: {one['because']}" if one["because"] else "yes"
            seen.setdefault(words, []).append(one["name"])
    rows = sorted(seen.items(), reverse=True)
    rows += [(f"no: {reason}", names) for reason, names in hidden_names(result).items()]
    title = f"What this record can test: {sum(map(len, seen.values()))} of {len(told)} names"
    columns: tuple[Column, ...] = (
        ("can this record show it", lambda row: row[0]),
        ("names", lambda row: ", ".join(row[1])),
    )
    return Table.of(title, columns, rows, wide=True, stacked=True, folded=True)
