"""Blocks of scans to registers and back, with echo and checksum."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.node.registers import BLOCK_DATA_REGISTERS, BLOCK_HEADER_REGISTERS

__all__ = [
    "DATA_AT",
    "HEADER",
    "SCAN_BYTES",
    "BlockHeader",
    "RawBlock",
    "block_fault",
    "decode_block",
    "encode_block",
    "encode_scans",
    "seal_block",
]

# four codes and a 32-bit encoder: what the node keeps of a scan
SCAN_BYTES = 12
# echo, run, seq, flags with channels, scans, depth, first index, encoder, checksum
HEADER = struct.Struct(">HHHHHHIiI")
DATA_AT = 2 * BLOCK_HEADER_REGISTERS
_CRC_AT = DATA_AT - 4
_WINDOW_REGISTERS = BLOCK_HEADER_REGISTERS + BLOCK_DATA_REGISTERS


@dataclass(frozen=True, slots=True)
class BlockHeader:
    """What stands before the scans of a block.

    Parameters
    ----------
    run, seq, flags, depth, first_index : int
        Fields of the register map; flags without the channels.
    channels : int
        Bits of the words in a scan.
    """

    run: int
    seq: int
    flags: int
    depth: int
    first_index: int
    channels: int


@dataclass(frozen=True, slots=True)
class RawBlock:
    """One block as it stands on the wire.

    Parameters
    ----------
    header : BlockHeader
        Its fields.
    words : ndarray of int16, shape (n, words)
        Codes, and the chosen words of the encoder.
    encoder : int
        Encoder at the first scan, counts modulo 2**32.
    """

    header: BlockHeader
    words: NDArray[np.int16]
    encoder: int


def encode_scans(codes: NDArray[np.int16], encoder: NDArray[np.int64]) -> bytes:
    """Return whole scans as the node's buffer keeps them."""
    scans = np.empty((len(codes), SCAN_BYTES // 2), dtype=">u2")
    scans[:, :4] = codes.astype(np.int16).view(np.uint16)
    wrapped = (encoder & 0xFFFFFFFF).astype(np.uint32)
    scans[:, 4] = wrapped >> 16
    scans[:, 5] = wrapped & 0xFFFF
    return scans.tobytes()


def encode_block(header: BlockHeader, scans: bytes) -> bytes:
    """Return the block window without its echo: header, checksum still 0, chosen channels."""
    whole = np.frombuffer(scans, dtype=">u2").reshape(-1, SCAN_BYTES // 2)
    columns = [word for word in range(SCAN_BYTES // 2) if header.channels >> word & 1]
    encoder = struct.unpack_from(">i", scans, 8)[0] if scans else 0
    head = HEADER.pack(
        0,
        header.run,
        header.seq,
        header.flags | header.channels << 8,
        len(whole),
        header.depth,
        header.first_index,
        encoder,
        0,
    )
    return (head + whole[:, columns].tobytes()).ljust(2 * _WINDOW_REGISTERS, b"\0")


def seal_block(window: bytes, echo: int) -> bytes:
    """Return the window of `encode_block` with echo and checksum."""
    body = struct.pack(">H", echo) + window[2:_CRC_AT]
    data = window[DATA_AT : DATA_AT + _data_bytes(body)]
    return body + struct.pack(">I", zlib.crc32(data, zlib.crc32(body))) + window[DATA_AT:]


def block_fault(raw: bytes) -> str:
    """Return why the bytes of a block window cannot be what the node sent; empty if they can."""
    if not len(raw) >= DATA_AT:
        return f"{len(raw)} bytes of a block, shorter than a header: its checksum is missing"
    end = DATA_AT + 2 * raw[6].bit_count() * (raw[8] << 8 | raw[9])
    if not end <= len(raw):
        return f"{end - DATA_AT} bytes of scans in a block of {len(raw) - DATA_AT}"
    told = int.from_bytes(raw[_CRC_AT:DATA_AT], "big")
    if zlib.crc32(raw[DATA_AT:end], zlib.crc32(raw[:_CRC_AT])) != told:
        return "the checksum of the block is wrong"
    return ""


def decode_block(raw: bytes) -> RawBlock:
    """Return the block that stands in the bytes of a window without `block_fault`."""
    fault = block_fault(raw)
    if fault:
        raise ValueError(fault)
    _, run, seq, flags, n_scans, depth, first_index, encoder, _ = HEADER.unpack_from(raw)
    channels = flags >> 8
    width = channels.bit_count()
    words = np.frombuffer(raw, dtype=">i2", count=n_scans * width, offset=DATA_AT)
    header = BlockHeader(run, seq, flags & 0xFF, depth, first_index, channels)
    return RawBlock(header, words.reshape(n_scans, width).astype(np.int16), encoder)


def _data_bytes(raw: bytes) -> int:
    """Return how many bytes of scans follow the header, as it says itself."""
    return 2 * raw[6].bit_count() * int.from_bytes(raw[8:10], "big")
