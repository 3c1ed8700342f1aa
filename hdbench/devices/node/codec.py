"""Values to registers and back: big-endian, most significant word first."""

from __future__ import annotations

import struct
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.node.registers import (
    BLOCK_HEADER_REGISTERS,
    BLOCK_REGISTERS,
    BLOCK_SCANS,
    SCAN_REGISTERS,
    Register,
)

__all__ = [
    "RawBlock",
    "Value",
    "as_float32",
    "clean_text",
    "decode_block",
    "decode_group",
    "encode_block",
    "encode_group",
    "encode_scans",
]

Value = int | float | str
_FORMATS = {"u16": ">H", "i16": ">h", "u32": ">I", "i32": ">i", "f32": ">f"}


@dataclass(frozen=True, slots=True)
class RawBlock:
    """One block as it stands on the wire.

    Parameters
    ----------
    seq, flags, depth, first_index : int
        Header fields of the register map.
    codes : ndarray of int16, shape (n, 4)
        Torque, tacho, current and reference codes.
    encoder : ndarray of int32, shape (n,)
        Encoder counts modulo 2**32.
    """

    seq: int
    flags: int
    depth: int
    first_index: int
    codes: NDArray[np.int16]
    encoder: NDArray[np.int32]


def as_float32(value: float) -> float:
    """Return `value` as the nearest 32-bit float, the form in which the node keeps it.

    Parameters
    ----------
    value : float
        Any number within the range of 32-bit floats.

    Returns
    -------
    float
    """
    return float(np.float32(value))


def clean_text(raw: bytes) -> str:
    """Return device text without control, format and undecodable characters.

    Parameters
    ----------
    raw : bytes
        UTF-8, ended by NUL or its length.

    Returns
    -------
    str
    """
    text = raw.split(b"\0", 1)[0].decode("utf-8", errors="replace")
    printable = (c for c in text if unicodedata.category(c)[0] != "C")
    return "".join(printable).replace("\N{REPLACEMENT CHARACTER}", "").strip()


def _encode(entry: Register, value: Value) -> bytes:
    if entry.kind == "text":
        return str(value).encode()[:16].ljust(16, b"\0")
    return struct.pack(_FORMATS[entry.kind], value)


def _decode(entry: Register, raw: bytes) -> Value:
    if entry.kind == "text":
        return clean_text(raw)
    value: int | float = struct.unpack(_FORMATS[entry.kind], raw)[0]
    return value


def encode_group(group: Sequence[Register], values: Mapping[str, Value]) -> bytes:
    """Return the bytes of `group`, one value for each of its names.

    Parameters
    ----------
    group : sequence of Register
        Adjacent entries of the map.
    values : mapping of str to int, float or str
        A value for every name of the group.

    Returns
    -------
    bytes
        Two bytes per register.

    Raises
    ------
    struct.error
        If a value does not fit its type.
    KeyError
        If a value is missing.
    """
    return b"".join(_encode(entry, values[entry.name]) for entry in group)


def decode_group(group: Sequence[Register], raw: bytes) -> dict[str, Value]:
    """Return the values of `group` from the bytes of its registers.

    Parameters
    ----------
    group : sequence of Register
        Adjacent entries of the map.
    raw : bytes
        Two bytes per register.

    Returns
    -------
    dict of str to int, float or str
        Values by register name.
    """
    start = group[0].address
    return {
        entry.name: _decode(
            entry, raw[2 * (entry.address - start) : 2 * (entry.address - start + entry.size)]
        )
        for entry in group
    }


def encode_scans(codes: NDArray[np.int16], encoder: NDArray[np.int64]) -> bytes:
    """Return scans as interleaved registers.

    Parameters
    ----------
    codes : ndarray of int16, shape (n, 4)
        Torque, tacho, current and reference codes.
    encoder : ndarray of int64, shape (n,)
        Encoder counts; kept modulo 2**32.

    Returns
    -------
    bytes
        12 bytes per scan.
    """
    scans = np.empty((len(codes), SCAN_REGISTERS), dtype=">u2")
    scans[:, :4] = codes.astype(np.int16).view(np.uint16)
    wrapped = (encoder & 0xFFFFFFFF).astype(np.uint32)
    scans[:, 4] = wrapped >> 16
    scans[:, 5] = wrapped & 0xFFFF
    return scans.tobytes()


def encode_block(seq: int, flags: int, depth: int, first_index: int, scans: bytes) -> bytes:
    """Return the block window: header, `scans`, zero fill.

    Parameters
    ----------
    seq, flags, depth, first_index : int
        Header fields of the register map.
    scans : bytes
        Scans as `encode_scans` gives them, at most `BLOCK_SCANS`.

    Returns
    -------
    bytes
        Two bytes per register of the window.
    """
    n_scans = len(scans) // (2 * SCAN_REGISTERS)
    header = struct.pack(">HHHHI", seq, flags, n_scans, depth, first_index)
    return (header + scans).ljust(2 * BLOCK_REGISTERS, b"\0")


def decode_block(raw: bytes) -> RawBlock:
    """Return the block that stands in the bytes of the block window.

    Parameters
    ----------
    raw : bytes
        Two bytes per register of the window.

    Returns
    -------
    RawBlock

    Raises
    ------
    ValueError
        If the length is not that of the window or the header names more scans than it can hold.
    """
    if len(raw) != 2 * BLOCK_REGISTERS:
        raise ValueError(f"{len(raw)} bytes; needed: {2 * BLOCK_REGISTERS}")
    seq, flags, n_scans, depth, first_index = struct.unpack_from(">HHHHI", raw)
    if not n_scans <= BLOCK_SCANS:
        raise ValueError(f"{n_scans} scans in one block; needed: at most {BLOCK_SCANS}")
    scans = np.frombuffer(
        raw, dtype=">u2", count=n_scans * SCAN_REGISTERS, offset=2 * BLOCK_HEADER_REGISTERS
    ).reshape(n_scans, SCAN_REGISTERS)
    codes = scans[:, :4].astype(np.uint16).view(np.int16)
    encoder = ((scans[:, 4].astype(np.uint32) << 16) | scans[:, 5]).astype(np.uint32).view(np.int32)
    return RawBlock(seq, flags, depth, first_index, codes, encoder)
