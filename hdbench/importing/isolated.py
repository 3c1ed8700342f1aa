"""Files that a library reads in a process of its own, so that its crash is an error of the file."""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from hdbench.errors import DataError, HdbenchError, UsageError
from hdbench.importing.source import PIECE_ROWS, Channel, Piece, Source, damaged
from hdbench.system.children import child_command

__all__ = ["end_reader", "open_isolated"]

# threads of a library would hold memory of their own; its allocator has to heed the limit
_SETTINGS = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "NUMEXPR_MAX_THREADS": "1",
    "ARROW_DEFAULT_MEMORY_POOL": "system",
}
# then a new process is started: libraries do not give back all they took
_MOST_FILES = 200
_KINDS = ("<f8", "<i8", "<u8")


class ReaderProcess:
    """The process that reads; it serves several files and threads, one after another."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            child_command("hdbench.importing.readerprocess"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **_SETTINGS},
        )
        self._owner = os.getpid()
        self._lock = threading.Lock()
        self.opened = self.closed = 0
        atexit.register(self.end)

    @property
    def usable(self) -> bool:
        """Whether another file may be opened; not in a fork of the process that started it."""
        worn = self.opened >= _MOST_FILES and self.opened == self.closed
        return self._owner == os.getpid() and self._process.poll() is None and not worn

    def ask(self, order: dict[str, Any]) -> tuple[dict[str, Any], list[Any]]:
        """Return the head and the arrays of an answer; EOFError where the process ended."""
        with self._lock:
            try:
                return self._ask(order)
            except BaseException:
                # an answer that was not read whole cannot be told from the next one
                self.end()
                raise

    def _ask(self, order: dict[str, Any]) -> tuple[dict[str, Any], list[Any]]:
        to, back = self._process.stdin, self._process.stdout
        if to is None or back is None or to.closed:
            raise EOFError
        try:
            to.write(json.dumps(order).encode() + b"\n")
            to.flush()
        except BrokenPipeError:
            raise EOFError from None
        size = int.from_bytes(_exactly(back, 8), "little")
        head: dict[str, Any] = json.loads(_exactly(back, size))
        return head, [_array(back, kind, count) for kind, count in head.pop("kinds")]

    def why_ended(self) -> str:
        """Return what became of the process."""
        code = self._process.wait()
        return f"its reader crashed ({f'signal {-code}' if code < 0 else f'exit code {code}'})"

    def end(self) -> None:
        """End the process."""
        atexit.unregister(self.end)
        if self._owner != os.getpid():
            return
        self._process.poll()
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(BrokenPipeError):
                    pipe.close()


def _exactly(file: IO[bytes], count: int) -> bytes:
    data = file.read(count)
    if len(data) != count:
        raise EOFError
    return data


def _array(file: IO[bytes], kind: str, count: int) -> Any:
    if kind == "text":
        words = json.loads(_exactly(file, count))
        cells = np.empty(len(words), dtype=object)
        cells[:] = words
        return cells
    if kind not in _KINDS or count > PIECE_ROWS:
        raise EOFError
    return np.frombuffer(_exactly(file, 8 * count), dtype=kind)


_running: ReaderProcess | None = None


def _reader() -> ReaderProcess:
    global _running
    if _running is None or not _running.usable:
        if _running is not None:
            _running.end()
        _running = ReaderProcess()
    return _running


def end_reader() -> None:
    """End the process that reads, if there is one; the next file starts another."""
    if _running is not None:
        _running.end()


class _IsolatedSource(Source):
    def __init__(self, path: Path, form: str, module: str, library: str, extra: str) -> None:
        super().__init__(path, form)
        self._process = _reader()
        self._number = self._process.opened
        self._process.opened += 1
        head, _ = self._ask("open", module=module, library=library)
        if head.get("missing"):
            raise UsageError(
                f"{library} is not installed; needed for a {form}",
                where=str(path),
                fix=f"pip install 'hdbench[{extra}]'",
            )
        self.channels = tuple(Channel(**channel) for channel in head["channels"])
        self.notes = tuple(head["notes"])
        self.decimal_comma = head["decimal_comma"]

    def _ask(self, what: str, **more: Any) -> tuple[dict[str, Any], list[Any]]:
        order = {"do": what, "file": self._number, "path": str(self.path), "form": self.form}
        try:
            head, arrays = self._process.ask({**order, **more})
        except EOFError:
            raise damaged(self.path, self.form, self._process.why_ended()) from None
        if "error" in head:
            raise _as_error(head["error"])
        return head, arrays

    def pieces(self, names: Sequence[str]) -> Iterator[Piece]:
        """Yield what the reader yields."""
        self._ask("pieces", names=list(names))
        while True:
            head, arrays = self._ask("next")
            if head.get("end"):
                return
            yield dict(zip(head["names"], arrays, strict=True))

    def place(self, row: int) -> str:
        """Return what the reader returns."""
        return str(self._ask("place", row=row)[0]["place"])

    def close(self) -> None:
        """Close the file in the process that reads it."""
        self._process.closed += 1
        with suppress(HdbenchError):
            self._ask("close")


def _as_error(body: dict[str, Any]) -> HdbenchError:
    kind = UsageError if body["exit_code"] == UsageError.exit_code else DataError
    return kind(body["what"], where=body["where"], fix=body["fix"])


def open_isolated(path: Path, form: str, module: str, library: str, extra: str) -> Source:
    """Open a file by a reader in a process of its own."""
    return _IsolatedSource(path, form, module, library, extra)
