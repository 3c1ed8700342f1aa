"""Content of an input: its SHA-256, and the size and time of change by which it is known again."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hdbench.errors import nothing_stored
from hdbench.records.storage import sha256_file, storage_error

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
    try:
        digests = [(name, sha256_file(file)) for name, file in _files(path)]
    except OSError as error:
        raise storage_error(error, path) from error
    if path.is_dir():
        lines = "".join(f"{digest}  {name}\n" for name, digest in digests)
        total = hashlib.sha256(lines.encode()).hexdigest()
    else:
        total = digests[0][1]
    last_ns = max((changed for _, changed in (stamps or {}).values()), default=0)
    settled = last_ns < begin_ns - _SETTLED_NS
    return Content(total, stamps if settled else None)
