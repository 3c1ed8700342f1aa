"""Notes of people on a run: service, a new clamping, anything that later readers should know."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path

from hdbench.errors import DataError, UsageError
from hdbench.records.runfolder import read_manifest, utc_text
from hdbench.records.storage import file_bytes, storage_error
from hdbench.system.files import sync_folder

_NAME = "notes.jsonl"
_LIMIT_BYTES = 1 << 20
_LONGEST = 500


@dataclass(frozen=True, slots=True)
class RunNote:
    """One note.

    Parameters
    ----------
    utc : str
        When it was written, ISO 8601.
    text : str
        What it says.
    """

    utc: str
    text: str


def add_note(run: Path, text: str, moment: datetime) -> RunNote:
    """Append a note to a run and wait until the disk has it.

    Parameters
    ----------
    run : Path
        The run folder.
    text : str
        One line of at most 500 characters.
    moment : datetime
        Now, with a time zone.

    Returns
    -------
    RunNote

    Raises
    ------
    UsageError
        If the text is empty, longer, or not printable.
    DataError
        If `run` is no run folder.
    StorageError
        If it cannot be written.
    """
    text = text.strip()
    if not (0 < len(text) <= _LONGEST and text.isprintable()):
        raise UsageError(
            f"found a text of {len(text)} characters; needed: one line of 1 to {_LONGEST} "
            "printable characters",
            where="TEXT",
            fix="shorten it, such as 'new gauges' or 're-clamped'",
        )
    read_manifest(run)
    note = RunNote(utc_text(moment), text)
    file = run / _NAME
    try:
        # a file of its own: run.json belongs to the process that makes the run
        with file.open("ab") as stream:
            stream.write(json.dumps(asdict(note)).encode() + b"\n")
            stream.flush()
            os.fsync(stream.fileno())
        sync_folder(run)
    except OSError as error:
        raise storage_error(error, file) from error
    return note


def read_notes(run: Path) -> tuple[RunNote, ...]:
    """Return the notes of a run, oldest first.

    Parameters
    ----------
    run : Path
        The run folder.

    Returns
    -------
    tuple of RunNote
        Empty where there are none.

    Raises
    ------
    DataError
        If the file of the notes is damaged.
    """
    file = run / _NAME
    if not file.exists():
        return ()
    notes = []
    raw = file_bytes(file, limit=_LIMIT_BYTES, what="file of notes")
    for number, line in enumerate(raw.split(b"\n"), start=1):
        if not line.strip():
            continue
        try:
            body = json.loads(line)
            notes.append(RunNote(str(body["utc"]), str(body["text"])))
        except (ValueError, KeyError, TypeError) as error:
            raise DataError(
                "not a note; needed: one JSON object with utc and text a line",
                where=f"{file}:{number}",
                fix="mend or remove that line",
            ) from error
    return tuple(notes)
