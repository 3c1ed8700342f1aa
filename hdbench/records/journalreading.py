"""The journal of a run as it is read: never guessed at where it is torn.

A block is ``magic (4 bytes) | sequence (uint32) | length (uint32) | payload | CRC-32 (uint32)``,
little-endian; the CRC covers sequence, length and payload. The payload is
``header length (uint32) | header (JSON) | arrays``, the arrays (float64 or int64, little-endian)
in the order in which the header lists them.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import DataError
from hdbench.records.storage import file_bytes

__all__ = [
    "HEAD",
    "MAGIC",
    "WORD",
    "JournalBlock",
    "JournalContent",
    "iter_journal",
    "read_journal",
]

MAGIC = b"HDJ1"
HEAD = struct.Struct("<4sII")
WORD = struct.Struct("<I")
_DTYPES = ("<f8", "<i8")
# one block holds at most a second or so of samples; anything larger is damage
_LIMIT_BLOCK = 64 << 20
_LIMIT_FILE = 16 << 30


@dataclass(frozen=True, slots=True)
class JournalBlock:
    """One acknowledged entry.

    Parameters
    ----------
    sequence : int
        Number of the entry, from 0.
    kind : str
        ``samples``, ``reading`` or ``event``.
    columns : mapping of str to ndarray, each of shape (n,)
        Float64 or int64 channels.
    extra : dict
        What is known beside the columns.
    """

    sequence: int
    kind: str
    columns: Mapping[str, NDArray[Any]]
    extra: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class JournalContent:
    """What a journal holds.

    Parameters
    ----------
    blocks : tuple of JournalBlock
        Every intact block, in order.
    torn_bytes : int
        Bytes of an unfinished last block, cut off.
    problem : str or None
        Damage in the middle: which blocks are missing; None when there is none.
    """

    blocks: tuple[JournalBlock, ...]
    torn_bytes: int
    problem: str | None


def _block_at(raw: bytes, start: int) -> tuple[JournalBlock, int] | None:
    """Return the intact block at `start` and where it ends; None if there is none."""
    if len(raw) - start < HEAD.size + WORD.size or raw[start : start + 4] != MAGIC:
        return None
    _, sequence, length = HEAD.unpack_from(raw, start)
    end = start + HEAD.size + length + WORD.size
    if length > _LIMIT_BLOCK or end > len(raw):
        return None
    (checksum,) = WORD.unpack_from(raw, end - WORD.size)
    if zlib.crc32(memoryview(raw)[start + 4 : end - WORD.size]) != checksum:
        return None
    content = _decode(raw[start + HEAD.size : end - WORD.size])
    return None if content is None else (JournalBlock(sequence, *content), end)


def _decode(body: bytes) -> tuple[str, dict[str, NDArray[Any]], dict[str, Any]] | None:
    try:
        (size,) = WORD.unpack_from(body, 0)
        header = json.loads(body[WORD.size : WORD.size + size])
        offset = WORD.size + size
        columns: dict[str, NDArray[Any]] = {}
        for name, dtype, n in header["columns"]:
            if dtype not in _DTYPES or not (isinstance(n, int) and n >= 0):
                return None
            columns[str(name)] = np.frombuffer(body, dtype=dtype, count=n, offset=offset).copy()
            offset += 8 * n
        return str(header["kind"]), columns, dict(header["extra"])
    except (struct.error, ValueError, KeyError, TypeError, RecursionError):
        return None


def _next_block(raw: bytes, start: int, budget: int) -> int | None:
    """Return where an intact block starts at or after `start`, within `budget` bytes of CRC."""
    place = raw.find(MAGIC, start)
    while place >= 0 and budget > 0:
        if _block_at(raw, place) is not None:
            return place
        if len(raw) - place >= HEAD.size:
            budget -= min(HEAD.unpack_from(raw, place)[2], len(raw) - place)
        place = raw.find(MAGIC, place + 1)
    return None


def read_journal(path: Path) -> JournalContent:
    """Read every acknowledged block of a journal.

    Parameters
    ----------
    path : Path
        The journal.

    Returns
    -------
    JournalContent
        An unfinished last block is cut off and counted in ``torn_bytes``. Damage before intact
        blocks is reported in ``problem``; the intact blocks are kept, nothing is filled in.

    Raises
    ------
    DataError
        If the file is missing or not a journal.
    """
    raw = file_bytes(Path(path), limit=_LIMIT_FILE, what="journal")
    if raw and not MAGIC.startswith(raw[:4]) and _next_block(raw, 0, 4 * len(raw)) is None:
        raise DataError("not a journal", where=str(path), fix="name a run folder of hdbench")
    blocks: list[JournalBlock] = []
    problems: list[str] = []
    place, expected = 0, 0
    while place < len(raw):
        found = _block_at(raw, place)
        if found is None:
            following = _next_block(raw, place + 1, 4 * len(raw))
            if following is None:
                break
            problems.append(f"damaged from byte {place} to {following}")
            place = following
            continue
        block, place = found
        if block.sequence != expected:
            problems.append(f"block {block.sequence} stands where {expected} was due")
        expected = block.sequence + 1
        blocks.append(block)
    return JournalContent(tuple(blocks), len(raw) - place, "; ".join(problems) or None)


def iter_journal(path: Path, ends: list[int] | None = None) -> Iterator[JournalBlock]:
    """Yield the blocks of a journal one after the other, one in memory at a time."""
    path = Path(path)
    try:
        with path.open("rb") as file:
            start = 0
            while (found := _next_intact(file.read(HEAD.size), file.read)) is not None:
                yield found
                start = file.tell()
            file.seek(start)
            rest = file.read()
    except OSError as error:
        raise DataError(
            f"cannot read: {error.strerror}", where=str(path), fix="check path and rights"
        ) from error
    if ends is not None:
        ends.append(len(rest))
    yield from _behind(rest)


def _next_intact(head: bytes, read: Callable[[int], bytes]) -> JournalBlock | None:
    if len(head) < HEAD.size or head[:4] != MAGIC:
        return None
    length = HEAD.unpack(head)[2]
    if length > _LIMIT_BLOCK:
        return None
    found = _block_at(head + read(length + WORD.size), 0)
    return None if found is None else found[0]


def _behind(raw: bytes) -> Iterator[JournalBlock]:
    """Yield the intact blocks behind damage at the first byte; none where it is the torn end."""
    place = _next_block(raw, 1, 4 * len(raw))
    while place is not None:
        found = _block_at(raw, place)
        if found is None:
            place = _next_block(raw, place + 1, 4 * len(raw))
            continue
        block, place = found
        yield block
