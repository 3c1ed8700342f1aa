"""Journal file of a run: appended, synced, never guessed at where it is torn.

A block is ``magic (4 bytes) | sequence (uint32) | length (uint32) | payload | CRC-32 (uint32)``,
little-endian; the CRC covers sequence, length and payload. The payload is
``header length (uint32) | header (JSON) | arrays``, the arrays (float64 or int64, little-endian)
in the order in which the header lists them.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import BusyError, DataError, StorageError
from hdbench.records.storage import checked_size, disk_errors, read_errors
from hdbench.system.files import lock_file, sync_data, sync_file, sync_folder

_MAGIC = b"HDJ1"
_HEAD = struct.Struct("<4sII")
_WORD = struct.Struct("<I")
_DTYPES = ("<f8", "<i8")
# one block holds at most a second or so of samples; anything larger is damage
_LIMIT_BLOCK = 64 << 20
_LIMIT_FILE = 16 << 30


@dataclass(frozen=True, slots=True)
class JournalBlock:
    """One acknowledged entry."""

    sequence: int  # number of the entry, from 0
    kind: str  # `samples`, `reading` or `event`
    columns: Mapping[str, NDArray[Any]]  # float64 or int64 channels
    extra: dict[str, Any] = field(default_factory=dict)  # what is known beside the columns

    @property
    def rows(self) -> int:
        """Samples in each channel."""
        return len(next(iter(self.columns.values()), ()))


@dataclass(frozen=True, slots=True)
class JournalContent:
    """What a journal holds."""

    blocks: tuple[JournalBlock, ...]  # every intact block, in order
    torn_bytes: int  # bytes of an unfinished last block, cut off
    problem: str | None  # damage in the middle: which blocks are missing; None when there is none


def _block_at(raw: bytes, start: int) -> tuple[JournalBlock, int] | None:
    """Return the intact block at `start` and where it ends; None if there is none."""
    if len(raw) - start < _HEAD.size + _WORD.size or raw[start : start + 4] != _MAGIC:
        return None
    _, sequence, length = _HEAD.unpack_from(raw, start)
    end = start + _HEAD.size + length + _WORD.size
    if length > _LIMIT_BLOCK or end > len(raw):
        return None
    (checksum,) = _WORD.unpack_from(raw, end - _WORD.size)
    if zlib.crc32(memoryview(raw)[start + 4 : end - _WORD.size]) != checksum:
        return None
    content = _decode(raw[start + _HEAD.size : end - _WORD.size])
    return None if content is None else (JournalBlock(sequence, *content), end)


def _decode(body: bytes) -> tuple[str, dict[str, NDArray[Any]], dict[str, Any]] | None:
    try:
        (size,) = _WORD.unpack_from(body, 0)
        header = json.loads(body[_WORD.size : _WORD.size + size])
        offset = _WORD.size + size
        columns: dict[str, NDArray[Any]] = {}
        for name, dtype, n in header["columns"]:
            if dtype not in _DTYPES or not (isinstance(n, int) and n >= 0):
                return None
            columns[str(name)] = np.frombuffer(body, dtype=dtype, count=n, offset=offset).copy()
            offset += 8 * n
        return str(header["kind"]), columns, dict(header["extra"])
    except (struct.error, ValueError, KeyError, TypeError, RecursionError):
        return None


def _search(raw: bytes, start: int) -> int | None:
    """Return where an intact block starts at or after `start`; None if there is none."""
    # bytes that are summed at most: damage made to harm could ask for any number
    budget = 4 * len(raw)
    place = raw.find(_MAGIC, start)
    while place >= 0 and budget > 0:
        if _block_at(raw, place) is not None:
            return place
        if len(raw) - place >= _HEAD.size:
            budget -= min(_HEAD.unpack_from(raw, place)[2], len(raw) - place)
        place = raw.find(_MAGIC, place + 1)
    return None


class JournalReader:
    """The intact blocks of a journal, one in memory at a time."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self.torn_bytes = 0
        self._problems: list[str] = []

    @property
    def problem(self) -> str | None:
        """Damage in the middle; None when there is none."""
        return "; ".join(self._problems) or None

    def __iter__(self) -> Iterator[JournalBlock]:
        self.torn_bytes, self._problems, expected = 0, [], 0
        for block in self._intact():
            if block.sequence != expected:
                self._problems.append(f"block {block.sequence} stands where {expected} was due")
            expected = block.sequence + 1
            yield block

    def _intact(self) -> Iterator[JournalBlock]:
        checked_size(self.path, limit=_LIMIT_FILE, what="journal")
        start = 0
        with read_errors(self.path), self.path.open("rb") as file:
            while (block := _next_intact(file)) is not None:
                yield block
                start = file.tell()
            file.seek(start)
            rest = file.read()
        place = 0
        while (following := _search(rest, place + 1)) is not None:
            self._problems.append(f"damaged from byte {start + place} to {start + following}")
            found = _block_at(rest, following)
            while found is not None:
                block, place = found
                yield block
                found = _block_at(rest, place)
        if not (start or place or _MAGIC.startswith(rest[:4])):
            raise DataError(
                "not a journal", where=str(self.path), fix="name a run folder of hdbench"
            )
        self.torn_bytes = len(rest) - place


def _next_intact(file: BinaryIO) -> JournalBlock | None:
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size or not head.startswith(_MAGIC):
        return None
    length = _HEAD.unpack(head)[2]
    if length > _LIMIT_BLOCK:
        return None
    found = _block_at(head + file.read(length + _WORD.size), 0)
    return None if found is None else found[0]


def read_journal(path: Path) -> JournalContent:
    """Read every intact block of a journal; damage before others is told, nothing is filled in."""
    reader = JournalReader(path)
    blocks = tuple(reader)
    return JournalContent(blocks, reader.torn_bytes, reader.problem)


def _payload(kind: str, columns: Mapping[str, NDArray[Any]], extra: Mapping[str, Any]) -> bytes:
    listed, arrays = [], []
    for name, values in columns.items():
        array = np.asarray(values)
        dtype = "<i8" if array.dtype.kind in "iub" else "<f8"
        if array.ndim != 1:
            raise ValueError(f"column {name} has {array.ndim} dimensions; needed: 1")
        listed.append([name, dtype, len(array)])
        arrays.append(np.ascontiguousarray(array, dtype=dtype).tobytes())
    header = json.dumps(
        {"kind": kind, "columns": listed, "extra": dict(extra)}, allow_nan=False
    ).encode()
    return b"".join([_WORD.pack(len(header)), header, *arrays])


class JournalWriter:
    """Append blocks to a journal; a synced block is on the disk when `append` returns.

    After a failed write nothing can be appended: what stands behind a half-written block could not
    be told from damage.
    """

    __slots__ = ("_handle", "_path", "_sequence")

    def __init__(self, path: Path, *, flags: int = os.O_CREAT | os.O_EXCL) -> None:
        self._path = Path(path)
        self._sequence = 0
        self._handle = -1
        flags |= os.O_WRONLY | os.O_APPEND | getattr(os, "O_BINARY", 0)
        with self._abandoned_on_error():
            self._handle = os.open(self._path, flags, 0o644)
            sync_folder(self._path.parent)
            # without locks the process number in run.json is the only guard
            if lock_file(self._handle) is False:
                raise BusyError(
                    "another process records this run",
                    where=str(self._path),
                    fix="wait until it has finished, or stop it",
                )

    @classmethod
    def resume(cls, path: Path) -> tuple[JournalWriter, JournalContent]:
        """Go on behind the last intact block of a journal; return what stood there, too.

        An unfinished block behind it, which was never acknowledged, is cut off.
        """
        writer = cls(path, flags=0)
        handle = writer._handle
        with writer._abandoned_on_error():
            content = read_journal(path)
            if content.torn_bytes:
                os.ftruncate(handle, os.fstat(handle).st_size - content.torn_bytes)
                sync_file(handle)
        writer._sequence = content.blocks[-1].sequence + 1 if content.blocks else 0
        return writer, content

    def append(
        self,
        kind: str,
        columns: Mapping[str, NDArray[Any]],
        extra: Mapping[str, Any] | None = None,
        *,
        sync: bool = True,
    ) -> None:
        """Write one block and, with `sync`, wait until the disk has it and all before it.

        Without, it survives the end of this process, not yet a power cut.
        """
        if self._handle < 0:
            raise StorageError(
                "the journal is closed", where=str(self._path), fix="start a new run"
            )
        body = _payload(kind, columns, extra or {})
        head = _HEAD.pack(_MAGIC, self._sequence, len(body))
        checksum = zlib.crc32(body, zlib.crc32(head[4:]))
        rest = memoryview(b"".join([head, body, _WORD.pack(checksum)]))
        with self._abandoned_on_error():
            while rest:
                rest = rest[os.write(self._handle, rest) :]
            if sync:
                sync_data(self._handle)
        self._sequence += 1

    def close(self) -> None:
        """Sync and close the file; safe to call twice."""
        if self._handle < 0:
            return
        with self._abandoned_on_error():
            sync_data(self._handle)
        self._abandon()

    @contextmanager
    def _abandoned_on_error(self) -> Iterator[None]:
        try:
            with disk_errors(self._path):
                yield
        except BaseException:
            self._abandon()
            raise

    def _abandon(self) -> None:
        handle, self._handle = self._handle, -1
        if handle >= 0:
            os.close(handle)

    def __enter__(self) -> JournalWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
