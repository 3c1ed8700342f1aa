"""The tables of a diagnosis: causes, places without a name, and what could have been missed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.report import inspection
from hdbench.report.diagnosis_limits import hidden_names
from hdbench.report.elements import Table
from hdbench.report.numbers import DASH, name_words, plain, probability, stated, unit_of, unit_words

__all__ = ["tables"]

_CAUSE_HEAD = ("cause", "parameters", "what speaks for it")
_PLACE_HEAD = ("axis", "place", "size")
_VOICE_HEAD = ("cause", "record", "what it says", "size in it alone")
_RECORD_HEAD = ("record", "held-out, simulation (N·m)", "held-out, extended (N·m)", "remark")
_LEAST_HEAD = ("cause", "amplitude (N·m)")
_NAMES_HEAD = ("can this record show it", "names")


def tables(result: Mapping[str, Any]) -> tuple[Table, ...]:
    """List causes, unexplained places, what could have been missed and what cannot show."""
    causes = tuple(_cause_row(cause) for cause in result.get("causes", ()))
    minor = tuple(_cause_row(cause) for cause in result.get("minor", ()))
    places = tuple(_place_row(place) for place in result.get("unexplained", ()))
    least = tuple(
        (str(m.get("name")), plain(m.get("amplitude_nm")))
        for m in result.get("minimum_detectable", ())
    )
    found = (
        Table("Causes", _CAUSE_HEAD, causes, wide=True, stacked=True),
        Table("Smaller causes", _CAUSE_HEAD, minor, wide=True, stacked=True),
        _voices(result),
        _records(result),
        Table("Unexplained", _PLACE_HEAD, places, stacked=True),
        Table("Smallest effect this record would have shown", _LEAST_HEAD, least),
        _names(result),
    )
    inspected = result.get("inspection")
    told = inspection.tables(inspected) if inspected else ()
    return (*(table for table in found if table.rows), *told)


def _voices(result: Mapping[str, Any]) -> Table:
    """List what each of several records says of each cause; no rows for one record."""
    rows = []
    for cause in (*result.get("causes", ()), *result.get("minor", ())):
        for one in cause.get("records", ()):
            sizes = one["parameters"]
            words = [
                f"{name_words(key)}: {plain(sizes[key])} {unit_words(unit_of(sizes[key]))}"
                for key in stated(sizes)
            ]
            verdict = "disagrees" if one["disagrees"] else ""
            nats = f"{one['evidence_nats']:.1f} nats"
            gain = f"explains {_percent(one['gain']['explained_fraction'])}"
            rows.append(
                (
                    str(cause["name"]),
                    str(one["record"]),
                    "\n".join(x for x in (nats, gain, verdict) if x),
                    "\n".join(words) or DASH,
                )
            )
    note = (
        "By how much the likelihood of each record falls without the cause, and the size of the "
        "cause as that record alone has it, beside all that the records share."
    )
    title = "Which record speaks for which cause"
    return Table(title, _VOICE_HEAD, tuple(rows), note if rows else "", wide=True, stacked=True)


def _records(result: Mapping[str, Any]) -> Table:
    """List the records of a diagnosis of several; no rows for one record."""
    rows = []
    for one in result.get("records", ()):
        before, after = (one[key]["heldout_rms_nm"] for key in ("simulated", "extended"))
        remark = f"left out: {one['left_out']}" if one["left_out"] else ""
        if one["disagrees"]:
            remark = f"disagrees about {', '.join(dict.fromkeys(one['disagrees']))}"
        rows.append((str(one["record"]), plain(before), plain(after), remark or DASH))
    return Table("Records", _RECORD_HEAD, tuple(rows), wide=True, stacked=True)


def _cause_row(cause: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a cause: its name and others, one parameter a line, what speaks for it."""
    name, parameters = str(cause.get("name")), cause.get("parameters", {})
    alike = [str(x) for x in (*cause.get("group", ()), *cause.get("rivals", ()))]
    others = [f"or {x}" for x in dict.fromkeys(alike) if x != name]
    sizes = [
        f"{name_words(key)}: {plain(parameters[key])} {unit_words(unit_of(parameters[key]))}"
        for key in stated(parameters)
    ]
    gain = cause.get("gain") or {}
    speaks = [
        f"explains {_percent(gain.get('explained_fraction'))}",
        f"false alarm {probability(cause.get('false_alarm_probability'))}",
    ]
    if cause.get("separating_experiment"):
        speaks.append(f"told apart by: {cause['separating_experiment']}")
    return "\n".join((name, *others)), "\n".join(sizes), "\n".join(speaks)


def _place_row(place: Mapping[str, Any]) -> tuple[str, ...]:
    axes = [str(place.get("domain"))]
    if place.get("second_domain"):
        axes.append(f"with {place['second_domain']}")
    unit = "" if place.get("unit") in (None, "1") else f" {place['unit']}"
    low, high = place.get("extent") or (None, None)
    where = f"{plain(place.get('location'))}{unit}\n{plain(low)} to {plain(high)}{unit}"
    share = f"{_percent(place.get('share_of_variance'))} of the variance"
    return "\n".join(axes), where, f"{plain(place.get('size_nm'))} N·m\n{share}"


def _names(result: Mapping[str, Any]) -> Table:
    """List by reason which names of the catalogue this record can show."""
    told = result.get("testable") or ()
    seen: dict[str, list[str]] = {}
    for one in told:
        if one["testable"]:
            words = f"in part: {one['because']}" if one["because"] else "yes"
            seen.setdefault(words, []).append(str(one["name"]))
    rows = [(words, ", ".join(names)) for words, names in sorted(seen.items(), reverse=True)]
    hidden = hidden_names(result)
    rows += [(f"no: {reason}", ", ".join(names)) for reason, names in hidden.items()]
    shown = sum(map(len, seen.values()))
    title = f"What this record can test: {shown} of {len(told)} names"
    return Table(title, _NAMES_HEAD, tuple(rows), wide=True, stacked=True, folded=True)


def _percent(value: Any) -> str:
    return f"{100.0 * value:.1f} %" if isinstance(value, int | float) else DASH
