"""Text files within limits: size, packing ratio, encoding, and errors that name the line."""

from __future__ import annotations

import zlib
from pathlib import Path

from hdbench.errors import DataError
from hdbench.records.storage import file_bytes

__all__ = ["IMPORT_FIX", "data_error", "read_text"]

# 600 s at 5 kHz with ten channels of full precision are 0.6 GB as text
_LIMIT_BYTES = 1 << 30
# text of real samples shrinks 2 to 20 times; deflate itself cannot pass 1032
_LIMIT_RATIO = 300
# below this a high ratio does no harm
_SMALL_BYTES = 16 << 20
IMPORT_FIX = "bring the file in with 'hdbench import' (--help shows how to name its columns)"


def data_error(path: Path, line: int, what: str, fix: str = IMPORT_FIX) -> DataError:
    """Return a `DataError` at one line of a file."""
    return DataError(what, where=f"{path}:{line}", fix=fix)


def _inflate(path: Path, packed: bytes) -> bytes:
    limit = max(_SMALL_BYTES, min(_LIMIT_BYTES, len(packed) * _LIMIT_RATIO))
    parts: list[bytes] = []
    total, rest = 0, packed
    try:
        while rest:
            engine = zlib.decompressobj(wbits=31)
            part = engine.decompress(rest, limit - total + 1)
            total += len(part)
            if total > limit:
                raise DataError(
                    f"unpacks to more than {limit} bytes from {len(packed)}",
                    where=str(path),
                    fix="check that this is the right file, or unpack it by hand and split it",
                )
            if not engine.eof:
                raise zlib.error("the end of the file is missing")
            parts.append(part)
            rest = engine.unused_data.lstrip(b"\0")
    except zlib.error as error:
        raise DataError(
            f"damaged gzip file: {error}", where=str(path), fix="copy the file again"
        ) from error
    return b"".join(parts)


def read_text(path: Path, what: str, *, keep_bom: bool = True) -> str:
    r"""Read a text file, gzip-packed where its name ends with ``.gz``; lines end with ``\n``."""
    raw = file_bytes(path, limit=_LIMIT_BYTES, what=what)
    if path.suffix == ".gz":
        raw = _inflate(path, raw)
    try:
        text = raw.decode("utf-8" if keep_bom else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise data_error(
            path, line, "not UTF-8 text", "save the file as UTF-8, comma separated"
        ) from error
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise data_error(path, line, "holds a NUL character; needed: plain text", "copy it again")
    return text.replace("\r\n", "\n") if "\r" in text else text
