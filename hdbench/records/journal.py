"""The journal of a run: appended, synced, and resumed behind its last whole block."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import BusyError, StorageError
from hdbench.records.journalreading import (
    HEAD,
    MAGIC,
    WORD,
    JournalBlock,
    JournalContent,
    read_journal,
)
from hdbench.records.storage import storage_error
from hdbench.system.files import lock_file, sync_data, sync_file, sync_folder

__all__ = ["JournalBlock", "JournalContent", "JournalWriter", "read_journal"]


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
    return b"".join([WORD.pack(len(header)), header, *arrays])


def _lock(handle: int, path: Path) -> None:
    """Let one process append; without locks the process number in run.json is the only guard."""
    if lock_file(handle) is False:
        raise BusyError(
            "another process records this run",
            where=str(path),
            fix="wait until it has finished, or stop it",
        )


class JournalWriter:
    """Append blocks to a journal; a synced block is on the disk when `append` returns.

    Parameters
    ----------
    path : Path
        File to make; it must not exist. `JournalWriter.resume` goes on with one that does.
    flags : int
        How to open it.

    Raises
    ------
    StorageError
        If the file cannot be made.
    BusyError
        If another process appends to it.
    """

    __slots__ = ("_handle", "_path", "_sequence")

    def __init__(self, path: Path, *, flags: int = os.O_CREAT | os.O_EXCL) -> None:
        self._path = Path(path)
        self._sequence = 0
        self._handle = -1
        flags |= os.O_WRONLY | os.O_APPEND | getattr(os, "O_BINARY", 0)
        try:
            self._handle = os.open(self._path, flags, 0o644)
            sync_folder(self._path.parent)
            _lock(self._handle, self._path)
        except BusyError:
            self._abandon()
            raise
        except OSError as error:
            self._abandon()
            raise storage_error(error, self._path) from error

    @classmethod
    def resume(cls, path: Path) -> tuple[JournalWriter, JournalContent]:
        """Go on with the journal of a run that ended early.

        Parameters
        ----------
        path : Path
            The journal.

        Returns
        -------
        writer : JournalWriter
            Appends behind the last intact block; an unfinished one behind it, which was never
            acknowledged, is cut off.
        content : JournalContent
            What stood there, with the bytes that were cut.

        Raises
        ------
        BusyError
            If another process appends to it.
        DataError
            If the file is not a journal.
        StorageError
            If it cannot be written.
        """
        writer = cls(path, flags=0)
        try:
            content = read_journal(path)
            writer._cut(content.torn_bytes)
        except BaseException:
            writer._abandon()
            raise
        writer._sequence = content.blocks[-1].sequence + 1 if content.blocks else 0
        return writer, content

    def _cut(self, torn_bytes: int) -> None:
        if not torn_bytes:
            return
        try:
            os.ftruncate(self._handle, os.fstat(self._handle).st_size - torn_bytes)
            sync_file(self._handle)
        except OSError as error:
            raise storage_error(error, self._path) from error

    def append(
        self,
        kind: str,
        columns: Mapping[str, NDArray[Any]],
        extra: Mapping[str, Any] | None = None,
        *,
        sync: bool = True,
    ) -> None:
        """Write one block and, with `sync`, wait until the disk has it and all before it.

        Parameters
        ----------
        kind : str
            ``samples`` (channels of a trace, ``time_s`` among them), ``reading`` (a load reading
            in `extra`, by the names of the loads columns) or ``event``.
        columns : mapping of str to ndarray, each of shape (n,)
            Channels; floats become float64, integers and booleans int64.
        extra : mapping, optional
            Anything JSON can hold, without NaN.
        sync : bool
            False leaves the block with the operating system: it survives the end of this process,
            not yet a power cut.

        Raises
        ------
        StorageError
            If the disk is full or failed. Nothing can be appended after that: what stands behind
            a half-written block could not be told from damage.
        ValueError
            If a column is not one-dimensional or `extra` holds NaN.
        """
        if self._handle < 0:
            raise StorageError(
                "the journal is closed", where=str(self._path), fix="start a new run"
            )
        body = _payload(kind, columns, extra or {})
        head = HEAD.pack(MAGIC, self._sequence, len(body))
        checksum = zlib.crc32(body, zlib.crc32(head[4:]))
        rest = memoryview(b"".join([head, body, WORD.pack(checksum)]))
        try:
            while rest:
                rest = rest[os.write(self._handle, rest) :]
            if sync:
                sync_data(self._handle)
        except OSError as error:
            self._abandon()
            raise storage_error(error, self._path) from error
        self._sequence += 1

    def close(self) -> None:
        """Sync and close the file; safe to call twice.

        Raises
        ------
        StorageError
            If the last blocks could not be synced.
        """
        if self._handle < 0:
            return
        try:
            sync_data(self._handle)
        except OSError as error:
            raise storage_error(error, self._path) from error
        finally:
            self._abandon()

    def _abandon(self) -> None:
        handle, self._handle = self._handle, -1
        if handle >= 0:
            os.close(handle)

    def __enter__(self) -> JournalWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
