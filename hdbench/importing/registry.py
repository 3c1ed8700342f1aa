"""Which reader takes a file: its first bytes decide, never its name."""

from __future__ import annotations

import importlib
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.importing.isolated import open_isolated
from hdbench.importing.source import Asked, Piece, Source, told
from hdbench.importing.text import ForeignFormat, open_text

__all__ = ["FORMATS", "Format", "open_source"]

_HEAD = 1024


@dataclass(frozen=True, slots=True)
class Format:
    """One kind of file.

    Parameters
    ----------
    name : str
        For people.
    module : str
        Reader, a module of ``hdbench.importing.readers`` with ``open_file(path)``.
    endings : tuple of str
        Usual ends of the name: a file so named that does not begin so is damaged.
    begins : callable
        Whether a file that begins with these bytes is of this kind.
    library, extra : str
        What reads it, and the extra that brings it; empty where nothing has to be installed.
    """

    name: str
    module: str
    endings: tuple[str, ...]
    begins: Callable[[bytes, Path], bool]
    library: str = ""
    extra: str = ""


def _magic(*magic: bytes) -> Callable[[bytes, Path], bool]:
    return lambda head, _path: head.startswith(magic)


def _zip_with(start: str) -> Callable[[bytes, Path], bool]:
    def holds(head: bytes, path: Path) -> bool:
        if not head.startswith(b"PK\x03\x04"):
            return False
        try:
            with zipfile.ZipFile(path) as archive:
                return any(name.startswith(start) for name in archive.namelist())
        except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
            return False

    return holds


def _numpy(head: bytes, path: Path) -> bool:
    if head.startswith(b"\x93NUMPY"):
        return True
    return head.startswith(b"PK\x03\x04") and not _zip_with("xl/")(head, path)


def _hdf5(head: bytes, _path: Path) -> bool:
    # MATLAB 7.3 puts 512 bytes of its own before
    magic = b"\x89HDF\r\n\x1a\n"
    return head.startswith(magic) or head[512:520] == magic


def _json(head: bytes, _path: Path) -> bool:
    return (
        head.removeprefix(b"\xef\xbb\xbf")
        .lstrip()
        .startswith((b"{", b"[{", b"[ {", b"[\n", b"[\r"))
    )


FORMATS = (
    Format("Excel workbook", "excel", (".xlsx", ".xlsm"), _zip_with("xl/"), "openpyxl", "excel"),
    Format("NumPy file", "npz", (".npz", ".npy"), _numpy),
    Format("MATLAB 5 file", "mat5", (".mat",), _magic(b"MATLAB 5.0 MAT-file")),
    Format("HDF5 file", "hdf5", (".mat", ".h5", ".hdf5", ".hdf"), _hdf5, "h5py", "hdf5"),
    Format("Parquet file", "parquet", (".parquet",), _magic(b"PAR1"), "pyarrow", "parquet"),
    Format("TDMS file", "tdms", (".tdms",), _magic(b"TDSm"), "nptdms", "tdms"),
    Format(
        "MDF file",
        "mdf",
        (".mf4", ".mdf", ".dat"),
        _magic(b"MDF     ", b"UnFinMF "),
        "asammdf",
        "mdf",
    ),
    Format(
        "ROS bag",
        "ros",
        (".db3", ".bag", ".mcap"),
        _magic(b"SQLite format 3\0", b"#ROSBAG V2.0", b"\x89MCAP0\r\n"),
        "rosbags",
        "ros",
    ),
    Format("JSON file", "jsonrecords", (".json", ".jsonl", ".ndjson"), _json),
)


class _Guarded(Source):
    """A source whose reader may raise anything on damaged bytes; here it becomes our error."""

    def __init__(self, inner: Source) -> None:
        super().__init__(inner.path, inner.form)
        self._inner = inner
        self.channels, self.notes = inner.channels, inner.notes
        self.decimal_comma = inner.decimal_comma

    def pieces(self, names: Sequence[str]) -> Iterator[Piece]:
        """Yield what the reader yields."""
        try:
            yield from self._inner.pieces(names)
        except Exception as error:
            raise told(self.path, self.form, error) from error

    def place(self, row: int) -> str:
        """Return what the reader returns."""
        return self._inner.place(row)

    def close(self) -> None:
        """Close the reader."""
        self._inner.close()


def _head(path: Path) -> bytes:
    try:
        if not path.exists():
            raise DataError("no such log", where=str(path), fix="check the path")
        if path.is_dir():
            return b""
        if not path.is_file():
            what = "not a regular file; needed: a log"
            raise DataError(what, where=str(path), fix="name the file itself")
        with path.open("rb") as file:
            return file.read(_HEAD)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise DataError(
            f"cannot read: {reason}", where=str(path), fix="check path and rights"
        ) from error


def _chosen(path: Path, head: bytes) -> Format | None:
    """Return the kind of a file; None for text."""
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return next(kind for kind in FORMATS if kind.module == "ros")
        what = "a folder without metadata.yaml; needed: a log, or the folder of a ROS 2 bag"
        raise DataError(what, where=str(path), fix="name the file itself")
    found = next((kind for kind in FORMATS if kind.begins(head, path)), None)
    named = [kind for kind in FORMATS if path.suffix.lower() in kind.endings]
    # MDF is not the only one that ends with .dat, and text may end with anything
    binary = b"\0" in head or not head.strip()
    if found is None and named and (binary or path.suffix.lower() not in (".dat", ".json")):
        kinds = " or ".join(kind.name for kind in named)
        raise DataError(
            f"begins with {head[:8]!r}; needed: the first bytes of a {kinds}",
            where=str(path),
            fix="copy the file again; if it is text, give it the ending .csv",
        )
    return found


def open_source(path: Path, layout: ForeignFormat, asked: Asked | None = None) -> Source:
    """Open a foreign file."""
    path = Path(path)
    kind = _chosen(path, _head(path))
    try:
        source = open_text(path, layout) if kind is None else _reader(kind, path)
    except Exception as error:
        form = "text" if kind is None else kind.name
        raise told(path, form, error) from error
    guarded = _Guarded(source)
    if not guarded.channels:
        guarded.close()
        what = f"no channel of numbers in this {source.form}; needed: at least one"
        raise DataError(what, where=str(path), fix="check the file, or record again")
    if asked is not None:
        guarded.keep(asked)
    return guarded


def _reader(kind: Format, path: Path) -> Source:
    if kind.library:
        return open_isolated(path, kind.name, kind.module, kind.library, kind.extra)
    module: Any = importlib.import_module(f"hdbench.importing.readers.{kind.module}")
    source: Source = module.open_file(path)
    return source
