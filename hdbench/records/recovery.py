"""Give a killed run its trace or loads back from its journal."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hdbench.errors import DataError, nothing_stored
from hdbench.records.attempts import reading_entries, sample_groups, standing_blocks
from hdbench.records.course import write_course
from hdbench.records.journal import JournalBlock, JournalContent, read_journal
from hdbench.records.journalsummary import summarize_journal
from hdbench.records.loads import LoadReading, Loads
from hdbench.records.loadsfile import write_loads
from hdbench.records.reserve import free_reserve
from hdbench.records.runfolder import RunFolder
from hdbench.records.streaming import survey_samples
from hdbench.records.trace import FloatArray, Trace

__all__ = [
    "acknowledged",
    "blocks_trace",
    "data_file",
    "journal_loads",
    "journal_trace",
    "recover_run",
    "resolve_input",
]


def _length(block: JournalBlock) -> int:
    return len(next(iter(block.columns.values()), ()))


def acknowledged(content: JournalContent, kind: str) -> int:
    """Return how many samples or readings a journal holds."""
    blocks = [block for block in content.blocks if block.kind == kind]
    return len(blocks) if kind == "reading" else sum(map(_length, blocks))


def journal_trace(content: JournalContent, source: str) -> Trace:
    """Put the sample blocks of a journal together."""
    return blocks_trace(standing_blocks(sample_groups(content)), source)


def blocks_trace(blocks: Sequence[JournalBlock], source: str) -> Trace:
    """Put sample blocks together."""
    if not blocks:
        raise DataError("no samples in the journal", where=source, fix="run the experiment again")
    if not all("time_s" in block.columns for block in blocks):
        raise DataError("samples without time_s", where=source, fix="run the experiment again")
    names = list(dict.fromkeys(name for block in blocks for name in block.columns))
    columns: dict[str, FloatArray] = {}
    for name in names:
        parts = [block.columns.get(name, np.full(_length(block), np.nan)) for block in blocks]
        columns[name] = np.concatenate(parts).astype(np.float64)
    return Trace(columns, source)


def journal_loads(content: JournalContent, source: str) -> Loads:
    """Put the load readings of a journal together."""
    known = {f.name for f in dataclasses.fields(LoadReading)}
    found = reading_entries(content)
    entries = [reading.entry for reading in found if reading.superseded is None]
    if not entries:
        raise DataError("no readings in the journal", where=source, fix="run it again")
    try:
        readings = tuple(
            LoadReading(**{name: value for name, value in entry.items() if name in known})
            for entry in entries
        )
    except TypeError as error:
        raise DataError(
            f"a reading lacks a field: {error}", where=source, fix="run it again"
        ) from error
    others = dict.fromkeys(name for entry in entries for name in entry if name not in known)
    extra = {name: tuple(_text(entry.get(name)) for entry in entries) for name in others}
    return Loads(readings, source, {}, extra)


def _text(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return "" if value is None else str(value)


def _is_calibration(folder: RunFolder) -> bool:
    return str(folder.manifest["kind"]).startswith("calib")


def data_file(folder: RunFolder) -> tuple[Path, str]:
    """Return the file that a run's data stand in, and the kind of journal block it comes from."""
    return (folder.loads, "reading") if _is_calibration(folder) else (folder.trace, "samples")


def recover_run(folder: RunFolder) -> Path:
    """Write trace or loads of a killed run from its journal, and mark it ``incomplete``.

    Parameters
    ----------
    folder : RunFolder
        A run whose process is gone.

    Returns
    -------
    Path
        The file that was written.

    Raises
    ------
    DataError
        If the run still goes on, or its journal is missing or holds nothing.
    StorageError
        If the disk is full or failed.
    """
    if folder.status() == "running":
        raise DataError(
            f"the run still goes on (process {folder.manifest.get('pid')})",
            where=str(folder.path),
            fix="wait for it to end",
        )
    problem = summarize_journal(folder.journal).problem
    if _is_calibration(folder):
        content = read_journal(folder.journal)
        target = folder.loads
        write_loads(target, journal_loads(content, str(folder.journal)))
        write_course(folder.path, content)
    else:
        target = folder.trace
        survey_samples(folder.journal).write(target)
    free_reserve(folder.path)
    if folder.manifest["status"] == "running":
        damage = f"; {problem}" if problem else ""
        folder.finish("incomplete", f"killed; recovered from its journal{damage}")
    else:
        folder.add_files([target])
    return target


def resolve_input(path: Path) -> Path:
    """Return the trace or loads file that `path` stands for.

    Parameters
    ----------
    path : Path
        A file, which stands for itself, or a run folder: its ``trace.csv`` or ``loads.csv``. A
        killed run gets its file from its journal first.

    Returns
    -------
    Path

    Raises
    ------
    DataError
        If nothing is there, or the folder is not a run with data.
    StorageError
        If a file has to be recovered and cannot be written.
    """
    path = Path(path)
    if path.is_file():
        return path
    if not path.is_dir():
        raise nothing_stored(path)
    folder = RunFolder.open(path)
    if folder.is_killed and folder.journal.exists():
        return recover_run(folder)
    first, second = (folder.trace, folder.loads)
    if _is_calibration(folder):
        first, second = second, first
    for candidate in (first, second):
        if candidate.is_file():
            return candidate
    if not folder.journal.exists():
        raise DataError(
            f"this {folder.manifest['kind']} run holds no trace.csv, loads.csv or journal.hdj",
            where=str(path),
            fix="name a run of an experiment",
        )
    return recover_run(folder)
