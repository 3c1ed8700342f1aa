"""The diagnosis section of a report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from hdbench.report import inspection
from hdbench.report.diagnosis.limits import hidden_names, left_out_line, rest_line
from hdbench.report.numbers import (
    DASH,
    fixed,
    name_words,
    parameter_words,
    plain,
    probability,
    short,
    stated,
    unit_of,
    unit_words,
)
from hdbench.report.pagemodel import KeyNumber, Level, Picture, Table, Verdict
from hdbench.report.source import Source
from hdbench.results.diagnosis import (
    DiagnosisResult,
    Gain,
    NamedCause,
    ParameterValue,
    RecordPart,
    Unexplained,
)

_VERDICTS: dict[str, tuple[Level, str]] = {
    "nothing-found": ("good", "Nothing found: what the simulation leaves looks like noise."),
    "named": ("look", "The simulation misses something that can be named"),
    "unexplained": ("look", "The simulation misses something that has no name yet"),
    "named-and-unexplained": ("look", "The simulation misses several things, not all named"),
    "data-bad": ("bad", "The data do not allow a diagnosis."),
    "cannot-tell": ("look", "The record is too short or too noisy to tell."),
}

# what says where a cause sits and how large it is; the rest stands in the table
_TELLING = ("order", "frequency_hz", "amplitude_nm")
# findings that the verdict states with their size; of more it gives the names
_SIZED = 3


def verdict(result: DiagnosisResult) -> Verdict:
    """Say whether the simulation misses something, and what."""
    level, words = _VERDICTS.get(result.verdict, ("look", f"Verdict {result.verdict}."))
    if level == "good" and rest_line(result):
        level, words = "look", "Nothing found, but more is left than noise."
    if len(result.causes) + len(result.unexplained) > _SIZED:
        names = [cause.name for cause in result.causes]
        places = [f"unexplained at {place.domain}" for place in result.unexplained]
    else:
        names = [_cause_words(cause) for cause in result.causes]
        places = [_place_words(place) for place in result.unexplained]
    if names or places:
        words = words.rstrip(".") + ": " + "; ".join([*names, *places]) + "."
    elif result.reason:
        words = f"{words} {result.reason}"
    return Verdict(level, words, tuple(_limits(result)))


def _limits(result: DiagnosisResult) -> Iterator[str]:
    """Say what took no part and what is left above the noise."""
    left_out, rest = left_out_line(result), rest_line(result)
    if left_out:
        yield f"Left out: {left_out}."
    if rest:
        yield f"Rest: {unit_words(rest)}."


def _cause_words(cause: NamedCause) -> str:
    parameters = cause.parameters
    telling = [name for name in _TELLING if name in parameters]
    sized = [name for name, value in parameters.items() if value.unit == "N m"]
    chosen = telling or sized[:1]
    parts = [parameter_words(name, parameters[name]) for name in chosen]
    return f"{cause.name} ({', '.join(parts)})" if parts else cause.name


def _place_words(place: Unexplained) -> str:
    return (
        f"unexplained of {short(place.size_nm)} N·m at {place.domain} {plain(place.location)} "
        f"{place.unit}"
    )


def numbers(result: DiagnosisResult, run_id: str) -> tuple[KeyNumber, ...]:
    """Return the parameters of every cause and the gain on held-out data."""
    rows: list[tuple[Any, str, str, str]] = []
    for i, cause in enumerate(result.causes):
        for name, value in stated(cause.parameters).items():
            key = f"causes[{i}].parameters.{name}"
            rows.append((value, f"{cause.name}: {name_words(name)}", key, unit_of(value)))
    for key, words in (("simulated", "simulation"), ("extended", "extended")):
        rms = getattr(result, key).heldout_rms_nm
        rows.append((rms, f"held-out residual, {words}", f"{key}.heldout_rms_nm", "N m"))
    return KeyNumber.rows(rows, run_id)


def pictures(source: Source, prefix: str, doubts: list[str]) -> tuple[Picture, ...]:
    """Draw the residual before and after, in every domain."""
    from hdbench.report.diagnosis.figures import folder_pictures

    drawn = folder_pictures(source.folder, prefix)
    if not drawn:
        doubts.append("residual.csv is not there: the residual is not drawn.")
    inspected = source.result.inspection
    bands = inspection.picture(inspected, prefix) if inspected and drawn else None
    return drawn if bands is None else (*drawn, bands)


def tables(result: DiagnosisResult) -> tuple[Table, ...]:
    """List causes, unexplained places, what could have been missed and what cannot show."""
    told: Any = {"names": _names, "sizes": _sizes, "evidence": _evidence}
    places: Any = {"unit": _unit, "share": _share}
    found = Table.filled(
        Table.told("causes", result.causes, title="Causes", **told),
        Table.told("causes", result.minor, title="Smaller causes", **told),
        _records_of_causes(result),
        Table.told("records", result.records, remark=_remark),
        Table.told("unexplained", result.unexplained, **places),
        Table.told("detectable", result.minimum_detectable),
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
    rows = [(cause.name, one) for cause in (*result.causes, *result.minor) for one in cause.voices]
    return Table.told("voices", rows, explained=_explained, sizes=_sizes)


def _remark(record: RecordPart) -> str:
    if record.disagrees:
        return f"disagrees about {', '.join(dict.fromkeys(record.disagrees))}"
    return f"left out: {record.left_out}" if record.left_out else DASH


def _unit(place: Unexplained) -> str:
    return "" if place.unit == "1" else f" {place.unit}"


def _testable(result: DiagnosisResult) -> Table:
    """List by reason which names of the catalogue this record can show."""
    seen: dict[str, list[str]] = {}
    for one in result.testable:
        if one.testable:
            words = f"in part: {one.because}" if one.because else "yes"
            seen.setdefault(words, []).append(one.name)
    rows = sorted(seen.items(), reverse=True)
    rows += [(f"no: {reason}", names) for reason, names in hidden_names(result).items()]
    count = sum(map(len, seen.values()))
    return Table.told("testable", rows, seen=count, count=len(result.testable))
