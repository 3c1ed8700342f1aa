"""Folder of a batch: journal of rows as they come, results, and the table at the end.

``batch.jsonl`` has one line of JSON for every row, appended when it is done, so that a batch that
was killed goes on with ``--resume``. ``batch.csv`` and ``batch.parquet`` are written from it.
"""

from __future__ import annotations

import importlib
import json
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from hdbench.batch.inputs import Input, stamps_of
from hdbench.errors import BusyError, DataError, UsageError
from hdbench.records.csvtext import csv_text, safe_cell
from hdbench.records.parquetfile import require_parquet
from hdbench.records.storage import disk_errors, write_atomic
from hdbench.system.files import lock_file

# the same content fails or passes in the same way; anything else is worth another try
_LASTING = (0, 2, 3, 4, 6)
# first columns of the table, in the contract's order
_COLUMNS = ("input", "sha256", "exit_code", "error", "result", "verdict", "drive", "seconds")


class BatchFolder:
    """The folder of one batch, open for writing by one process.

    Parameters
    ----------
    path : Path
        The folder; made if missing.
    command : str
        Command of the batch: a folder belongs to one.
    resume : bool
        Go on with what is there; else the folder must not hold a batch.

    Raises
    ------
    UsageError
        If there is a batch and `resume` is not asked for, or it is another command's.
    BusyError
        If another process writes into the batch.
    StorageError
        If the folder cannot be written.
    """

    def __init__(self, path: Path, command: str, *, resume: bool) -> None:
        self.path = path
        self._journal = path / "batch.jsonl"
        entries = _journal_entries(self._journal)
        if entries and not resume:
            raise UsageError(
                f"the folder holds a batch with {len(entries) - 1} rows",
                where=str(path),
                fix="go on with what is missing by --resume, or name another --out",
            )
        if entries and entries[0].get("command") != command:
            raise UsageError(
                f"the folder holds a batch of {entries[0].get('command')}; found {command}",
                where=str(path),
                fix="name another --out",
            )
        self._kept = {entry["identity"]: entry for entry in entries[1:]}
        self._names = {identity: entry["name"] for identity, entry in self._kept.items()}
        with disk_errors(path):
            (path / "results").mkdir(parents=True, exist_ok=True)
            self._file = self._journal.open("a+b")
            # the lock ends with the process
            if lock_file(self._file.fileno()) is False:
                self._file.close()
                raise BusyError(
                    "another process writes into this batch",
                    where=str(path),
                    fix="wait for it, or name another --out",
                )
            # a line that a kill cut short must not swallow the next one
            if self._file.tell() and not self._journal.read_bytes().endswith(b"\n"):
                self._file.write(b"\n")
            shutil.rmtree(self.parts, ignore_errors=True)
            self.parts.mkdir()
        if not entries:
            self._append({"command": command})

    @property
    def parts(self) -> Path:
        """Folder of results that are being made; what a dead worker leaves there is void."""
        return self.path / ".parts"

    def close(self) -> None:
        """Take away what was being made, and let others write."""
        shutil.rmtree(self.parts, ignore_errors=True)
        self._file.close()

    def names(self, inputs: Sequence[Input]) -> list[str]:
        """Return a name for the results of every input: that of the input, made unique.

        Parameters
        ----------
        inputs : sequence of Input
            All inputs of the batch.

        Returns
        -------
        list of str
            The same for the same inputs in the same order; an input keeps the name that it had.
        """
        taken = {name.casefold() for name in self._names.values()}
        for entry in inputs:
            identity = identity_of(entry)
            if identity in self._names:
                continue
            stem = entry.path.absolute().name or "input"
            for suffix in (".gz", ".csv", ".parquet"):
                stem = stem.removesuffix(suffix)
            name, number = stem, 2
            while name.casefold() in taken:
                name, number = f"{stem}-{number}", number + 1
            taken.add(name.casefold())
            self._names[identity] = name
        return [self._names[identity_of(entry)] for entry in inputs]

    def kept(self, entry: Input, asked: str) -> dict[str, Any] | None:
        """Return what is known of an input when the same was asked of it, and its result is there.

        Parameters
        ----------
        entry : Input
            The input.
        asked : str
            Digest of command, options, profile and version.

        Returns
        -------
        dict or None
            Its line of the journal.
        """
        known = self._kept.get(identity_of(entry))
        if known is None or known["asked"] != asked:
            return None
        row = known["row"]
        if row["exit_code"] not in _LASTING or row["sha256"] is None:
            return None
        if row["result"] is not None and known["result_stamps"] != stamps_of(self.result_path(row)):
            return None
        return known

    def result_path(self, row: Mapping[str, Any]) -> Path:
        """Return where the result of a row is, also after the folder was moved."""
        return self.path / "results" / Path(row["result"]).name

    def add(self, entry: Input, asked: str, name: str, done: Mapping[str, Any]) -> None:
        """Keep a row as soon as it is done.

        Parameters
        ----------
        entry : Input
            The input.
        asked : str
            Digest of command, options, profile and version.
        name : str
            Name of its results.
        done : mapping
            ``row`` and ``stamps`` of the input.

        Raises
        ------
        StorageError
            If the disk is full or failed.
        """
        row = done["row"]
        line = {
            "identity": identity_of(entry),
            "asked": asked,
            "name": name,
            "stamps": done["stamps"],
            "result_stamps": None if row["result"] is None else stamps_of(self.result_path(row)),
            "row": row,
        }
        self._kept[line["identity"]] = line
        self._append(line)

    def _append(self, line: Mapping[str, Any]) -> None:
        with disk_errors(self._journal):
            self._file.write(json.dumps(line, allow_nan=False).encode() + b"\n")
            self._file.flush()

    def write_table(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write the table as CSV and Parquet.

        Parameters
        ----------
        rows : sequence of mapping
            In the order of the inputs.

        Raises
        ------
        StorageError
            If the disk is full or failed.
        UsageError
            If the library for Parquet is missing.
        """
        os.fsync(self._file.fileno())
        columns = list(dict.fromkeys([*_COLUMNS, *(name for row in rows for name in row)]))
        text = csv_text(columns, ([safe_cell(row.get(name)) for name in columns] for row in rows))
        write_atomic(self.path / "batch.csv", text.encode("utf-8"))
        parquet = require_parquet("hdbench batch")
        pyarrow = importlib.import_module("pyarrow")
        table = pyarrow.table({name: [row.get(name) for row in rows] for name in columns})
        sink = pyarrow.BufferOutputStream()
        parquet.write_table(table, sink)
        write_atomic(self.path / "batch.parquet", sink.getvalue().to_pybytes())


def identity_of(entry: Input) -> str:
    """Return what tells an input from every other one of a batch."""
    return json.dumps([str(entry.path.absolute()), entry.profile, entry.calibration])


def _journal_entries(path: Path) -> list[dict[str, Any]]:
    """Return the whole lines of a journal, the first with the command; one cut short is void."""
    entries: list[dict[str, Any]] = []
    try:
        text = path.read_text(encoding="utf-8") if path.exists() else ""
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(
            f"cannot read the journal: {error}", where=str(path), fix="name another --out"
        ) from error
    for line in text.splitlines():
        with suppress(json.JSONDecodeError):
            entry = json.loads(line)
            if isinstance(entry, dict) and ("row" in entry or not entries):
                entries.append(entry)
    return entries


def summary_of(rows: Iterable[Mapping[str, Any]], kept: int) -> dict[str, int]:
    """Return how many rows are done now, failed, and kept from an earlier call.

    Parameters
    ----------
    rows : iterable of mapping
        All rows.
    kept : int
        Rows with a result that were not computed now.

    Returns
    -------
    dict
        ``done``, ``failed``, ``skipped``; together all rows.
    """
    results = [row["result"] is not None for row in rows]
    return {"done": sum(results) - kept, "failed": len(results) - sum(results), "skipped": kept}


def read_table(folder: Path) -> list[dict[str, Any]]:
    """Return the rows of a batch, in the order in which they were done.

    Parameters
    ----------
    folder : Path
        Folder of the batch, ended or not.

    Returns
    -------
    list of dict
        Of every input the newest row.

    Raises
    ------
    DataError
        If there is no batch.
    """
    entries = _journal_entries(folder / "batch.jsonl")
    if not entries:
        raise DataError(
            "no batch.jsonl", where=str(folder), fix="name a folder that hdbench batch wrote"
        )
    newest = {entry["identity"]: entry["row"] for entry in entries[1:]}
    return list(newest.values())
