"""Readers of foreign files: the first bytes choose one; a process of its own runs a library."""

from __future__ import annotations

import atexit
import importlib
import json
import os
import re
import sys
import threading
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from mmap import mmap
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from hdbench.errors import DataError, HdbenchError, UsageError, told_error
from hdbench.importing.source import PIECE_ROWS, Channel, Piece, Source, damaged, text_cells, told
from hdbench.records.storage import checked_size, read_errors
from hdbench.system.children import shared_memory, start_child

if TYPE_CHECKING:
    # who opens a file without one has no need to load what reads them
    from hdbench.importing.recipe import Recipe

_HEAD = 1024
# threads of a library would hold memory of their own; its allocator has to heed the limit
_SETTINGS = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "NUMEXPR_MAX_THREADS": "1",
    "ARROW_DEFAULT_MEMORY_POOL": "system",
}
# then a new process is started: libraries do not give back all they took
_MOST_FILES = 200
# what the process that reads puts its numbers into
_SHARED_BYTES = 8 << 20
_KINDS = ("<f8", "<i8", "<u8")
# MATLAB 7.3 puts 512 bytes of its own before
_HDF5 = rb"(?s:.{512})?\x89HDF\r\n\x1a\n"
_ROS = rb"SQLite format 3\0|#ROSBAG V2\.0|\x89MCAP0\r\n"
_JSON = rb"(?:\xef\xbb\xbf)?\s*(?:\{|\[ ?\{|\[[\r\n])"


@dataclass(frozen=True, slots=True)
class Format:
    """One kind of file."""

    name: str
    module: str  # reader, a module of `hdbench.importing.readers` with `open_file(path)`
    # usual ends of the name: a file so named that does not begin so is damaged
    endings: tuple[str, ...]
    begins: bytes  # regular expression of its first bytes
    # what reads it in a process of its own, brought by the extra that is called as the module;
    # empty where there is none
    library: str = ""


FORMATS = (
    Format("Excel workbook", "excel", (".xlsx", ".xlsm"), rb"PK\x03\x04", "openpyxl"),
    Format("NumPy file", "npz", (".npz", ".npy"), rb"\x93NUMPY|PK\x03\x04"),
    # SciPy is always there; some damaged files crash it
    Format("MATLAB 5 file", "mat5", (".mat",), rb"MATLAB 5\.0 MAT-file", "scipy.io"),
    Format("HDF5 file", "hdf5", (".mat", ".h5", ".hdf5", ".hdf"), _HDF5, "h5py"),
    Format("Parquet file", "parquet", (".parquet",), rb"PAR1", "pyarrow"),
    Format("TDMS file", "tdms", (".tdms",), rb"TDSm", "nptdms"),
    Format("MDF file", "mdf", (".mf4", ".mdf", ".dat"), rb"MDF     |UnFinMF ", "asammdf"),
    Format("ROS bag", "ros", (".db3", ".bag", ".mcap"), _ROS, "rosbags"),
    Format("JSON file", "jsonrecords", (".json", ".jsonl", ".ndjson"), _JSON),
)


_TEXT = Format("text", "text", (), b"")  # what is nothing else


def _chosen(path: Path) -> Format:
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return next(kind for kind in FORMATS if kind.module == "ros")
        what = "a folder without metadata.yaml; needed: a log, or the folder of a ROS 2 bag"
        raise DataError(what, where=str(path), fix="name the file itself")
    checked_size(path, limit=sys.maxsize, what="log")
    with read_errors(path), path.open("rb") as file:
        head = file.read(_HEAD)
    kinds = [kind for kind in FORMATS if re.match(kind.begins, head)]
    if kinds and kinds[0].module == "excel" and not _holds_workbook(path):
        kinds.pop(0)
    named = [kind for kind in FORMATS if path.suffix.lower() in kind.endings]
    # MDF is not the only one that ends with .dat, and text may end with anything
    binary = b"\0" in head or not head.strip()
    if not kinds and named and (binary or path.suffix.lower() not in (".dat", ".json")):
        needed = " or ".join(kind.name for kind in named)
        raise DataError(
            f"begins with {head[:8]!r}; needed: the first bytes of a {needed}",
            where=str(path),
            fix="copy the file again; if it is text, give it the ending .csv",
        )
    return next(iter(kinds), _TEXT)


def _holds_workbook(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return any(name.startswith("xl/") for name in archive.namelist())
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        return path.suffix.lower() in FORMATS[0].endings


def open_source(path: Path, recipe: Recipe | None = None) -> Source:
    """Open a foreign file with the channels that a recipe asks for."""
    path = Path(path)
    kind = _chosen(path)
    try:
        source = _opened(path, kind, recipe)
    except Exception as error:
        raise told(path, kind.name, error) from error
    if not source.channels:
        source.close()
        what = f"no channel of numbers in this {source.form}; needed: at least one"
        raise DataError(what, where=str(path), fix="check the file, or record again")
    if recipe is not None:
        source.keep(recipe.topic, recipe.joint)
    return source


def _opened(path: Path, kind: Format, recipe: Recipe | None) -> Source:
    if kind.library:
        return IsolatedSource(path, kind.name, kind.module, kind.library, kind.module)
    module: Any = importlib.import_module(f"hdbench.importing.readers.{kind.module}")
    source: Source = module.open_file(path, recipe) if kind is _TEXT else module.open_file(path)
    return source


class ReaderProcess:
    """The process that reads; it serves several files and threads, one after another."""

    def __init__(self) -> None:
        self._process = start_child("hdbench.importing.readerprocess", _SETTINGS)
        self._owner = os.getpid()
        self._lock = threading.Lock()
        self.opened = self.closed = 0
        atexit.register(self.end)

    @property
    def usable(self) -> bool:
        """Whether another file may be opened; not in a fork of the process that started it."""
        worn = self.opened >= _MOST_FILES and self.opened == self.closed
        return self._owner == os.getpid() and self._process.poll() is None and not worn

    def ask(self, order: dict[str, Any], memory: mmap | bytes) -> tuple[dict[str, Any], list[Any]]:
        """Return the head and the arrays of an answer; EOFError where the process ended."""
        with self._lock:
            try:
                return self._ask(order, memory)
            except BaseException:
                # an answer that was not read whole cannot be told from the next one
                self.end()
                raise

    def _ask(self, order: dict[str, Any], memory: mmap | bytes) -> tuple[dict[str, Any], list[Any]]:
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
        return head, _arrays(back, memory, head.pop("kinds", ()))

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


def _arrays(
    file: Any, memory: mmap | bytes, kinds: Sequence[tuple[str, int, int | None]]
) -> list[Any]:
    """Return the arrays of one piece: from the pipe, or as they lie in the memory."""
    found: list[Any] = []
    for kind, count, at in kinds:
        if kind == "text":
            found.append(text_cells(json.loads(_exactly(file, count))))
        elif kind not in _KINDS or count > PIECE_ROWS:
            raise EOFError
        elif at is not None:
            found.append(np.frombuffer(memory, kind, count, at))
        else:
            found.append(np.frombuffer(_exactly(file, 8 * count), kind))
    return found


_running: ReaderProcess | None = None


def _running_process() -> ReaderProcess:
    global _running
    if _running is None or not _running.usable:
        end_reader()
        _running = ReaderProcess()
    return _running


def end_reader() -> None:
    """End the process that reads, if there is one; the next file starts another."""
    if _running is not None:
        _running.end()


class IsolatedSource(Source):
    """A file that is read by a library in a process of its own."""

    def __init__(self, path: Path, form: str, module: str, library: str, extra: str) -> None:
        super().__init__(path, form)
        self._process = _running_process()
        self._number = self._process.opened
        self._memory: mmap | bytes = b""
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
            head, arrays = self._process.ask({**order, **more}, self._memory)
        except EOFError:
            raise damaged(self.path, self.form, self._process.why_ended()) from None
        if "error" in head:
            raise told_error(head["error"])
        return head, arrays

    def pieces(self, names: Sequence[str]) -> Iterator[Piece]:
        """Yield what the reader yields."""
        with shared_memory(_SHARED_BYTES) as (memory, path):
            self._ask("pieces", names=list(names), memory=path)
        self._memory = memory
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
