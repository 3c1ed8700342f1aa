"""Inputs of a batch: files, run folders, patterns, lists as CSV; and what an input holds."""

from __future__ import annotations

import csv
import glob
import hashlib
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from hdbench.errors import DataError, HdbenchError, UsageError, nothing_stored
from hdbench.records.jsonfile import read_json
from hdbench.records.storage import disk_errors, sha256_file

_LIST_COLUMNS = ("input", "profile", "calibration", "drive")
_DATA_SUFFIXES = (".csv", ".csv.gz", ".parquet")
# the head of a list is short; what is longer is a log
_HEAD_BYTES = 256


@dataclass(frozen=True, slots=True)
class Input:
    """One input of a batch.

    Parameters
    ----------
    path : Path
        A file or run folder, as it was named.
    profile, calibration, drive : str
        What a list says of it; empty where it says nothing.
    """

    path: Path
    profile: str = ""
    calibration: str = ""
    drive: str = ""


def expand_inputs(
    named: Sequence[str], *, kinds: Iterable[str] = (), any_file: bool = False, whole: bool = False
) -> list[Input]:
    """Return every input that was named, each once, in the order of naming.

    Parameters
    ----------
    named : sequence of str
        Files, run folders, folders, patterns such as ``'logs/**/*.csv'``, and lists: CSV files
        with the column ``input`` and none but ``profile``, ``calibration``, ``drive`` beside it.
        Paths in a list start at the list's folder.
    kinds : iterable of str
        Kinds of the runs to take out of a folder; empty takes all.
    any_file : bool
        Take every file out of a folder; else those that can be a trace or loads.
    whole : bool
        A folder is itself the input.

    Returns
    -------
    list of Input
        A path that does not exist stays in it, for its row to say so.

    Raises
    ------
    UsageError
        If a folder or pattern holds no input.
    DataError
        If a list is invalid.
    """
    found = {}
    for word in named:
        for entry in _expand(word, tuple(kinds), any_file, whole):
            found[entry.path.absolute(), entry.profile, entry.calibration] = entry
    return list(found.values())


def _expand(word: str, kinds: tuple[str, ...], any_file: bool, whole: bool) -> Iterator[Input]:
    path = Path(word)
    if not path.exists() and glob.has_magic(word):
        places = [Path(place) for place in sorted(glob.glob(word, recursive=True))]
        if not places:
            raise UsageError("no file fits the pattern", where=word, fix="check the pattern")
        for place in places:
            yield from _expand(str(place), kinds, any_file, whole)
    elif path.is_dir() and not whole and not (path / "run.json").is_file():
        places = list(_in_folder(path, kinds, any_file))
        if not places:
            of = f" of kind {' or '.join(kinds)}" if kinds else ""
            raise UsageError(
                f"no trace or loads file and no run{of} in the folder",
                where=word,
                fix="name a folder that holds some, or the files themselves",
            )
        yield from (Input(place) for place in places)
    elif _is_list(path):
        yield from _listed(path)
    else:
        yield Input(path)


def _in_folder(folder: Path, kinds: tuple[str, ...], any_file: bool) -> Iterator[Path]:
    for entry in sorted(folder.iterdir()):
        if entry.name.startswith("."):
            continue
        if (entry / "run.json").is_file():
            if not kinds or _kind(entry) in kinds:
                yield entry
        elif entry.is_dir():
            yield from _in_folder(entry, kinds, any_file)
        elif any_file or entry.name.endswith(_DATA_SUFFIXES):
            yield entry


def _kind(run: Path) -> str | None:
    """Return the kind of a run; one that cannot be read is taken, and its row says why."""
    try:
        return str(read_json(run / "run.json").get("kind"))
    except HdbenchError:
        return None


def _is_list(path: Path) -> bool:
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return False
    names = head.decode("utf-8-sig", errors="replace").splitlines()[:1]
    columns = [name.strip() for name in next(csv.reader(names), [])]
    return "input" in columns and set(columns) <= set(_LIST_COLUMNS)


def _listed(path: Path) -> Iterator[Input]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DataError(
            f"no list of inputs: {error}", where=str(path), fix="write it as CSV in UTF-8"
        ) from error
    for line, row in enumerate(rows, start=2):
        cells = {name.strip(): (value or "").strip() for name, value in row.items() if name}
        if not cells.get("input") or None in row:
            raise DataError(
                "no input in this row, or more cells than columns",
                where=f"{path}:{line}",
                fix="name one input in every row",
            )
        place = path.parent / cells["input"]
        profile, calibration = (
            _from(path.parent, cells.get(name, "")) for name in ("profile", "calibration")
        )
        yield Input(place, profile, calibration, cells.get("drive", ""))


def _from(folder: Path, text: str) -> str:
    """Return a path that starts at the list's folder; a name that is no file there stays."""
    return str(folder / text) if text and (folder / text).exists() else text


Stamps = dict[str, list[int]]
"""Size, byte, and time of change, ns, of every file by its name in the input."""

# a file that changed this short a time ago may change again without a new time of change
_SETTLED_NS = 2_000_000_000


@dataclass(frozen=True, slots=True)
class Content:
    """What an input holds.

    Parameters
    ----------
    sha256 : str
        Of the file; of a folder, of the list of its files as ``sha256sum`` prints it.
    stamps : dict or None
        Size and time of change of every file; None where one changed a moment ago, so that they
        say nothing yet.
    """

    sha256: str
    stamps: Stamps | None


def _files(path: Path) -> Iterator[tuple[str, Path]]:
    if path.is_dir():
        for file in sorted(path.rglob("*")):
            if file.is_file():
                yield file.relative_to(path).as_posix(), file
        return
    yield path.name, path


def stamps_of(path: Path) -> Stamps | None:
    """Return size and time of change of every file of an input.

    Parameters
    ----------
    path : Path
        A file, or a folder with all that is in it.

    Returns
    -------
    dict or None
        None where there is no such file.
    """
    found: Stamps = {}
    try:
        for name, file in _files(path):
            stat = file.stat()
            found[name] = [stat.st_size, stat.st_mtime_ns]
    except OSError:
        return None
    return found


def content_of(path: Path) -> Content:
    """Read an input and return what it holds.

    Parameters
    ----------
    path : Path
        A file or a folder.

    Returns
    -------
    Content

    Raises
    ------
    DataError
        If it is missing or cannot be read.
    StorageError
        If a folder cannot be listed.
    """
    if not path.exists():
        raise nothing_stored(path)
    begin_ns = time.time_ns()
    stamps = stamps_of(path)
    with disk_errors(path):
        digests = [(name, sha256_file(file)) for name, file in _files(path)]
    if path.is_dir():
        lines = "".join(f"{digest}  {name}\n" for name, digest in digests)
        total = hashlib.sha256(lines.encode()).hexdigest()
    else:
        total = digests[0][1]
    last_ns = max((changed for _, changed in (stamps or {}).values()), default=0)
    settled = last_ns < begin_ns - _SETTLED_NS
    return Content(total, stamps if settled else None)
