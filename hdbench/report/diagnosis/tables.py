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
)
from hdbench.report.pagemodel import Column, Table
from hdbench.report.texts import page_text
from hdbench.results.diagnosis import (
    DiagnosisResult,
    Gain,
    NamedCause,
    ParameterValue,
    RecordPart,
    Unexplained,
    Voice,
)


def tables(result: DiagnosisResult) -> tuple[Table, ...]:
    """List causes, unexplained places, what could have been missed and what cannot show."""
    columns: tuple[Column, ...] = (
        ("cause", _names),
        ("parameters", lambda cause: _sizes(cause.parameters)),
        ("what speaks for it", _evidence),
    )
    layout: Any = {"wide": True, "stacked": True}
    found = Table.filled(
        Table.of("Causes", columns, result.causes, **layout),
        Table.of("Smaller causes", columns, result.minor, **layout),
        _records_of_causes(result),
        Table.of(
            "Records",
            (
                ("record", "record", str),
                ("held-out, simulation (N·m)", "simulated.heldout_rms_nm"),
                ("held-out, extended (N·m)", "extended.heldout_rms_nm"),
                ("remark", _remark),
            ),
            result.records,
            **layout,
        ),
        Table.of(
            "Unexplained",
            (("axis", _axes), ("place", _place), ("size", _size)),
            result.unexplained,
            stacked=True,
        ),
        Table.of(
            "Smallest effect this record would have shown",
            (("cause", "name"), ("amplitude (N·m)", "amplitude_nm")),
            result.minimum_detectable,
        ),
        _testable(result),
    )
    inspected = result.inspection
    return (*found, *(inspection.tables(inspected) if inspected else ()))


def _names(cause: NamedCause) -> str:
    alike = dict.fromkeys((*cause.group, *cause.rivals))
    return "\n".join((cause.name, *(f"or {x}" for x in alike if x != cause.name)))


def _sizes(parameters: Mapping[str, ParameterValue]) -> str:
    """Return one parameter a line."""
    return "\n".join(
        f"{name_words(name)}: {plain(value)} {unit_words(unit_of(value))}"
        for name, value in stated(parameters).items()
    )


def _evidence(cause: NamedCause) -> str:
    words = [_explained(cause.gain), f"false alarm {probability(cause.false_alarm_probability)}"]
    if cause.separating_experiment:
        words.append(f"told apart by: {cause.separating_experiment}")
    return "\n".join(words)


def _explained(gain: Gain) -> str:
    return f"explains {_share(gain.explained_fraction)}"


def _share(value: float) -> str:
    return f"{fixed(100.0 * value, 1)} %"


def _records_of_causes(result: DiagnosisResult) -> Table:
    """List what each of several records says of each cause; no rows for one record."""

    def says(row: tuple[str, Voice]) -> str:
        one = row[1]
        words = (f"{one.evidence_nats:.1f} nats", _explained(one.gain))
        return "\n".join((*words, "disagrees") if one.disagrees else words)

    columns: tuple[Column, ...] = (
        ("cause", lambda row: row[0]),
        ("record", lambda row: row[1].record),
        ("what it says", says),
        ("size in it alone", lambda row: _sizes(row[1].parameters) or DASH),
    )
    rows = [(cause.name, one) for cause in (*result.causes, *result.minor) for one in cause.voices]
    title = "Which record speaks for which cause"
    return Table.of(title, columns, rows, page_text("voice_note"), wide=True, stacked=True)


def _remark(record: RecordPart) -> str:
    if record.disagrees:
        return f"disagrees about {', '.join(dict.fromkeys(record.disagrees))}"
    return f"left out: {record.left_out}" if record.left_out else DASH


def _axes(place: Unexplained) -> str:
    return f"{place.domain}\nwith {place.second_domain}" if place.second_domain else place.domain


def _place(place: Unexplained) -> str:
    unit = "" if place.unit == "1" else f" {place.unit}"
    low, high = place.extent
    return f"{plain(place.location)}{unit}\n{plain(low)} to {plain(high)}{unit}"


def _size(place: Unexplained) -> str:
    return f"{plain(place.size_nm)} N·m\n{_share(place.share_of_variance)} of the variance"


def _testable(result: DiagnosisResult) -> Table:
    """List by reason which names of the catalogue this record can show."""
    seen: dict[str, list[str]] = {}
    for one in result.testable:
        if one.testable:
            words = f"in part: {one.because}" if one.because else "yes"
            seen.setdefault(words, []).append(one.name)
    rows = sorted(seen.items(), reverse=True)
    rows += [(f"no: {reason}", names) for reason, names in hidden_names(result).items()]
    title = (
        f"What this record can test: {sum(map(len, seen.values()))} of {len(result.testable)} names"
    )
    columns: tuple[Column, ...] = (
        ("can this record show it", lambda row: row[0]),
        ("names", lambda row: ", ".join(row[1])),
    )
    return Table.of(title, columns, rows, wide=True, stacked=True, folded=True)
