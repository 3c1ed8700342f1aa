"""Sections of a report, one for each run, and the key figures of any result."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

from hdbench.errors import DataError
from hdbench.report import inspection, misalignment, ripple
from hdbench.report.calibration import section as calibration
from hdbench.report.diagnosis import section as diagnosis
from hdbench.report.numbers import plain
from hdbench.report.pagemodel import KeyNumber, Picture, Section, Table, Verdict, key_number
from hdbench.report.signals import filter_model_of
from hdbench.report.source import Source, typed_result
from hdbench.report.texts import summary

KINDS = {
    "calibration": calibration,
    "misalignment": misalignment,
    "ripple": ripple,
    "diagnosis": diagnosis,
}
_TITLES = {
    "calibration": "Calibration record",
    "misalignment": "Misalignment",
    "ripple": "Torque ripple",
    "diagnosis": "Diagnosis",
}
_MANIFEST = {
    "kind": "experiment",
    "drive": "drive",
    "sensor": "sensor",
    "status": "status",
    "exit_reason": "ended because",
    "started_utc": "started (UTC)",
    "ended_utc": "ended (UTC)",
    "hdbench_version": "hdbench",
    "host": "computer",
}
# nested entries of run.json that say with what the run was made
_NESTED = ("device", "versions", "simulation", "source")
# entries that say how a result was asked for, not what came out
_ASKED = ("profile", "input", "inputs", "settings", "filter", "files", "proposal")
_CAUSE = re.compile(r"causes\[(\d+)\]")


def make_section(source: Source, number: int, out: Path) -> Section:
    """Compose the section of one run."""
    kind = KINDS.get(source.kind)
    title = _TITLES.get(source.kind, f"File {source.run_id}")
    doubts = list(source.doubts)
    prefix = f"r{number}-" + re.sub(r"[^A-Za-z0-9]+", "-", source.kind)
    words, numbers = "", ()
    if kind is None or not source.result:
        what = f"this {source.kind} run has no" if kind else f"{source.run_id} holds data without a"
        verdict = Verdict("bad" if kind else "look", f"No verdict: {what} result.")
        pictures, tables = _data(source, prefix, doubts)
    else:
        try:
            verdict = kind.verdict(source.result)
            words = summary(source.kind, source.result, source.profile)
            numbers = kind.numbers(source.result, source.run_id)
            notes = Table.filled(Table.told("notes", source.stored.get("notes", ())))
            tables = (*kind.tables(source.result), *notes, *_filter_tables(source))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError(
                f"the {source.kind} result lacks or misshapes an entry: {error}",
                where=str(source.folder / "result.json"),
                fix="evaluate the run again with --from",
            ) from error
        pictures = kind.pictures(source, prefix, doubts)
    if doubts and verdict.level == "good":
        verdict = Verdict("look", f"{verdict.text} The data are doubtful or incomplete.")
    return Section(
        source.run_id,
        source.kind,
        title,
        verdict,
        tuple(dict.fromkeys(doubts)),
        words,
        numbers,
        pictures,
        tables,
        tuple(_provenance(source)),
        tuple(_raw_files(source, out)),
    )


def _data(
    source: Source, prefix: str, doubts: list[str]
) -> tuple[tuple[Picture, ...], tuple[Table, ...]]:
    """Return what can be drawn and told of data without a result."""
    if source.trace is not None:
        drawn = ripple.pictures(source, prefix, doubts)
        if source.profile is None:
            return drawn, ()
        from hdbench.diagnosis.inspection import inspect_trace

        seen = inspect_trace(source.trace, source.profile.data)
        found = seen.to_dict()
        bands = inspection.picture(found, prefix, seen.spectra)
        return (*drawn, *([bands] if bands else [])), inspection.tables(found)
    return calibration.data_pictures(source, prefix), ()


def _provenance(source: Source) -> Iterator[tuple[str, str]]:
    """Yield what was done, when, and with what."""
    yield "run", source.run_id
    for key, words in _MANIFEST.items():
        if source.manifest.get(key) not in (None, ""):
            yield words, plain(source.manifest[key])
    identity = source.manifest.get("profile") or source.stored.get("profile")
    if isinstance(identity, Mapping):
        yield "profile", plain(identity.get("name"))
        yield "profile SHA-256", plain(identity.get("sha256"))
    scale = source.stored.get("torque_scale") or source.detail("calibration")
    if isinstance(scale, Mapping) and source.kind != "calibration":
        yield "torque gain (N·m/V)", plain(scale.get("gain_nm_per_v"))
        yield "torque gain from", plain(scale.get("source"))
        if scale.get("sha256"):
            yield "calibration SHA-256", plain(scale["sha256"])
    for key in _NESTED:
        entries = source.detail(key)
        if isinstance(entries, Mapping):
            for name, value in entries.items():
                yield f"{key}: {name}", plain(value)


def _raw_files(source: Source, out: Path) -> Iterator[tuple[str, str, str]]:
    """Yield name, link relative to the report, and SHA-256 of the run's files."""
    files = [source.path] if source.path.is_file() else sorted(source.folder.iterdir())
    for file in files:
        if file != source.path and (not file.is_file() or file.name.startswith((".", "report."))):
            continue
        link = os.path.relpath(file.resolve(), out.resolve().parent)
        digest = source.manifest.get("files", {}).get(file.name, "")
        yield file.name, quote(Path(link).as_posix()), str(digest)


def _filter_tables(source: Source) -> tuple[Table, ...]:
    """Return the filter used, block by block, and where each number came from."""
    model = filter_model_of(source)
    if model is None or source.kind == "calibration":
        return ()
    return (
        Table.told("filter_blocks", model.blocks, name=model.name),
        Table.told("filter_numbers", model=model),
        Table.told("filter_origins", model.provenance.items()),
    )


def key_figures(result: Mapping[str, Any]) -> tuple[KeyNumber, ...]:
    """Return the key figures of a result: for a run those of its report."""
    kind = "".join(str(result.get("schema", "")).split("/")[1:2])
    module = KINDS.get(kind)
    if module is None:
        return tuple(_plain(result))
    causes = [cause["name"] for cause in result.get("causes", ())]
    return tuple(
        replace(
            n, quantity=_CAUSE.sub(lambda found: f"causes[{causes[int(found[1])]}]", n.quantity)
        )
        for n in module.numbers(typed_result(kind, result, "result"), "")
    )


def _plain(result: Mapping[str, Any]) -> Iterator[KeyNumber]:
    for key, body in result.items():
        if key in _ASKED:
            continue
        below = body.items() if isinstance(body, Mapping) and "value" not in body else ()
        for name, entry in ((key, body), *((f"{key}.{k}", v) for k, v in below)):
            number = key_number(entry, name.replace("_", " "), name, "", name)
            if number is not None:
                yield number
