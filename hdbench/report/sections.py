"""One section per run: verdict, words, numbers, figures, tables."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.diagnosis.inspection import inspect_trace
from hdbench.errors import DataError
from hdbench.report import calibration, diagnosis, inspection, misalignment, ripple
from hdbench.report.about import filter_tables, provenance, raw_files
from hdbench.report.elements import KeyNumber, Picture, Section, Table, Verdict
from hdbench.report.source import Source

__all__ = ["make_section"]


@dataclass(frozen=True, slots=True)
class _Kind:
    title: str
    verdict: Callable[[Mapping[str, Any]], Verdict]
    summary: Callable[[Mapping[str, Any], Source], str]
    numbers: Callable[[Mapping[str, Any], str], tuple[KeyNumber, ...]]
    pictures: Callable[[Source, str, list[str]], tuple[Picture, ...]]
    tables: Callable[[Mapping[str, Any]], tuple[Table, ...]]


@dataclass(frozen=True, slots=True)
class _Body:
    title: str
    verdict: Verdict
    summary: str
    numbers: tuple[KeyNumber, ...]
    pictures: tuple[Picture, ...]
    tables: tuple[Table, ...]


def _kind(title: str, module: Any) -> _Kind:
    return _Kind(
        title, module.verdict, module.summary, module.numbers, module.pictures, module.tables
    )


_KINDS = {
    "calibration": _kind("Calibration record", calibration),
    "misalignment": _kind("Misalignment", misalignment),
    "ripple": _kind("Torque ripple", ripple),
    "diagnosis": _kind("Diagnosis", diagnosis),
}


def make_section(source: Source, number: int, out: Path) -> Section:
    """Compose the section of one run."""
    kind = _KINDS.get(source.kind)
    doubts = list(source.doubts)
    prefix = f"r{number}-" + re.sub(r"[^A-Za-z0-9]+", "-", source.kind)
    if kind is None or not source.result:
        drawn, tables = _of_data(source, prefix, doubts)
        verdict = Verdict("look" if kind is None else "bad", _without_result(source))
        title = kind.title if kind is not None else f"File {source.run_id}"
        return _section(source, out, doubts, _Body(title, verdict, "", (), drawn, tables))
    try:
        verdict = kind.verdict(source.result)
        words = kind.summary(source.result, source)
        found = kind.numbers(source.result, source.run_id)
        tables = (*kind.tables(source.result), *_notes(source.result), *filter_tables(source))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DataError(
            f"the {source.kind} result lacks or misshapes an entry: {error}",
            where=str(source.folder / "result.json"),
            fix="evaluate the run again with --from",
        ) from error
    drawn = kind.pictures(source, prefix, doubts)
    body = _Body(kind.title, verdict, words, found, drawn, tables)
    return _section(source, out, doubts, body)


def _notes(result: Mapping[str, Any]) -> tuple[Table, ...]:
    rows = tuple(
        (str(note.get("name")), str(note.get("detail"))) for note in result.get("notes", ())
    )
    return (Table("What limits the evaluation", ("what", "in words"), rows),) if rows else ()


def _without_result(source: Source) -> str:
    if source.kind in _KINDS:
        return f"No verdict: this {source.kind} run has no result."
    return f"No verdict: {source.run_id} holds data without a result."


def _of_data(
    source: Source, prefix: str, doubts: list[str]
) -> tuple[tuple[Picture, ...], tuple[Table, ...]]:
    """Return what can be drawn and told of data without a result."""
    if source.trace is not None:
        drawn = ripple.pictures(source, prefix, doubts)
        if source.profile is None:
            return drawn, ()
        seen = inspect_trace(source.trace, source.profile.data)
        body = seen.to_dict()
        bands = inspection.picture(body, prefix, seen.spectra)
        return (*drawn, *([bands] if bands else [])), inspection.tables(body)
    if source.loads is not None:
        return calibration.data_pictures(source, prefix), ()
    return (), ()


def _section(source: Source, out: Path, doubts: list[str], body: _Body) -> Section:
    verdict = body.verdict
    if doubts and verdict.level == "good":
        verdict = Verdict("look", f"{verdict.text} The data are doubtful or incomplete.")
    return Section(
        source.run_id,
        source.kind,
        body.title,
        verdict,
        tuple(dict.fromkeys(doubts)),
        body.summary,
        body.numbers,
        body.pictures,
        body.tables,
        provenance(source),
        raw_files(source, out),
    )
