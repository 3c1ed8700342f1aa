"""Faults on the wire between a host and any emulated device: TCP, Modbus, serial bytes.

A framing knows where a frame ends and what its protocol unit is. A `Mangler` makes of one frame
what arrives: nothing, two of it, other bytes, later. It depends on frames and seed alone, and
counts what it changed. `faults.lines` puts it between a host and a device.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

__all__ = [
    "COUNTED",
    "ECHOED",
    "FAULT_KINDS",
    "PACKET_FAULTS",
    "Delivery",
    "FaultKind",
    "Mangler",
    "RawFraming",
    "RtuFraming",
    "Spoil",
    "TcpFraming",
    "flipped",
]

_HEADER = struct.Struct(">HHHB")
COUNTED = (1, 2, 3, 4, 23)
"""Function codes whose reply begins with a byte count."""

ECHOED = (5, 6, 15, 16)
"""Function codes whose reply repeats the request."""


class RawFraming:
    """Where a frame ends, and what in it is function code and data: here each read is a frame.

    Attributes
    ----------
    trailer : int
        Bytes of the checksum behind them.
    """

    trailer = 0

    def split(self, buffer: bytearray) -> list[bytes]:
        """Take everything."""
        data = bytes(buffer)
        buffer.clear()
        return [data] if data else []

    def unit(self, frame: bytes) -> bytes:
        """Return all bytes."""
        return frame

    def rebuild(self, frame: bytes, unit: bytes) -> bytes:
        """Return the other bytes."""
        return unit

    def with_address(self, frame: bytes) -> bytes:
        """Return the bytes as they are: nothing names their sender."""
        return frame


class TcpFraming(RawFraming):
    """Modbus TCP: a header of number, protocol, length and unit."""

    def split(self, buffer: bytearray) -> list[bytes]:
        """Take whole frames off the front of `buffer`."""
        frames: list[bytes] = []
        while len(buffer) >= _HEADER.size:
            end = 6 + struct.unpack_from(">H", buffer, 4)[0]
            if len(buffer) < end:
                break
            frames.append(bytes(buffer[:end]))
            del buffer[:end]
        return frames

    def unit(self, frame: bytes) -> bytes:
        """Return function code and data of a frame."""
        return frame[_HEADER.size :]

    def rebuild(self, frame: bytes, unit: bytes) -> bytes:
        """Return `frame` with other function code and data."""
        return frame[:4] + struct.pack(">H", len(unit) + 1) + frame[6:7] + unit

    def with_address(self, frame: bytes) -> bytes:
        """Return `frame` from another device."""
        return frame[:6] + bytes((frame[6] ^ 0x55,)) + frame[7:]


class RtuFraming(RawFraming):
    """Modbus RTU replies: address, function code, data, checksum.

    Parameters
    ----------
    crc : callable
        Checksum of bytes, as it stands on the wire.
    """

    trailer = 2

    def __init__(self, crc: Callable[[bytes], bytes]) -> None:
        self._crc = crc

    def split(self, buffer: bytearray) -> list[bytes]:
        """Take whole replies off the front of `buffer`; what is none of them passes as it is."""
        frames: list[bytes] = []
        while len(buffer) >= 3:
            function = buffer[1]
            size = 8 if function in ECHOED else 5 + buffer[2] if function in COUNTED else 5
            if len(buffer) < size:
                break
            frames.append(bytes(buffer[:size]))
            del buffer[:size]
        return frames

    def unit(self, frame: bytes) -> bytes:
        """Return function code and data of a frame."""
        return frame[1:-2]

    def rebuild(self, frame: bytes, unit: bytes) -> bytes:
        """Return `frame` with other function code and data."""
        body = frame[:1] + unit
        return body + self._crc(body)

    def with_address(self, frame: bytes) -> bytes:
        """Return `frame` from another device."""
        body = bytes((frame[0] ^ 0x55,)) + frame[1:-2]
        return body + self._crc(body)


FaultKind = Literal[
    "drop",
    "late",
    "duplicate",
    "reorder",
    "stale",
    "truncate",
    "mutate",
    "header",
    "noise",
    "garbage",
    "transaction",
    "unit",
    "protocol",
    "function",
    "count",
    "echo",
    "exception",
    "word-swap",
    "slow-loris",
    "fin",
    "reset",
]
"""What can happen to a frame; see `Mangler`."""

FAULT_KINDS: tuple[FaultKind, ...] = get_args(FaultKind)


@dataclass(frozen=True, slots=True)
class Delivery:
    """One piece that arrives.

    Parameters
    ----------
    data : bytes
        What arrives.
    after_s : float
        How much later than it was sent, s.
    per_byte_s : float
        Pause before each byte, s; 0 for all at once.
    then : {"", "fin", "reset"}
        What happens to the connection afterwards.
    """

    data: bytes
    after_s: float = 0.0
    per_byte_s: float = 0.0
    then: Literal["", "fin", "reset"] = ""


class Mangler:
    """Applies one kind of fault to a share of the frames.

    Parameters
    ----------
    kind : FaultKind
        ``drop``; ``late`` (by `late_s`); ``duplicate``; ``reorder`` (after the next frame);
        ``stale`` (the frame before in place of this one); ``truncate`` (some bytes at the end are
        missing); ``mutate`` (one bit of the frame);
        ``header`` (one bit before the values); ``noise`` (every bit with `bit_rate`);
        ``garbage`` (bytes before the frame); ``transaction``, ``protocol`` (Modbus TCP header);
        ``unit``; ``function``, ``count``, ``echo``, ``exception``, ``word-swap`` (well-formed
        replies that are wrong); ``slow-loris`` (`late_s` per byte); ``fin`` and ``reset`` (the
        connection ends before the frame).
    framing : RawFraming
        Of the wire.
    share : float
        Probability that a frame is affected, 0 to 1.
    seed : int
        Of the choice and of what is random in a fault.
    skip : int
        Frames that pass first.
    late_s, bit_rate : float
        See `kind`.

    Attributes
    ----------
    seen, changed : int
        Frames so far, and how many of them were affected.
    share : float
        May be set while frames pass.
    """

    def __init__(
        self,
        kind: FaultKind,
        framing: RawFraming,
        *,
        share: float = 1.0,
        seed: int = 0,
        skip: int = 0,
        late_s: float = 0.5,
        bit_rate: float = 1e-3,
    ) -> None:
        self.seen = self.changed = 0
        self.share = share
        self.framing = framing
        self._kind = kind
        self._random = np.random.default_rng(seed)
        self._skip = skip
        self._late_s = late_s
        self._bit_rate = bit_rate
        self._held: bytes | None = None
        self._before: bytes | None = None

    def __call__(self, frame: bytes) -> list[Delivery]:
        """Return what arrives in place of `frame`."""
        self.seen += 1
        held, self._held = self._held, None
        before, self._before = self._before, frame
        hit = self.seen > self._skip and float(self._random.random()) < self.share
        if not hit or held is not None:
            # a frame that was held back arrives after the one that follows it
            return [Delivery(piece) for piece in (frame, held) if piece is not None]
        arrives = self._apply(frame, before)
        self.changed += arrives != [Delivery(frame)]
        return arrives

    def _apply(self, frame: bytes, before: bytes | None) -> list[Delivery]:
        match self._kind:
            case "drop":
                return []
            case "late":
                return [Delivery(frame, after_s=self._late_s)]
            case "duplicate":
                return [Delivery(frame), Delivery(frame)]
            case "reorder":
                self._held = frame
                return []
            case "stale":
                return [Delivery(before if before is not None else frame)]
            case "slow-loris":
                return [Delivery(frame, per_byte_s=self._late_s)]
            case "fin":
                return [Delivery(b"", then="fin")]
            case "reset":
                return [Delivery(b"", then="reset")]
        return [Delivery(self._bytes(frame))]

    def _bytes(self, frame: bytes) -> bytes:
        """Return the other bytes of a fault that keeps the timing."""
        random = self._random
        match self._kind:
            case "truncate":
                return frame[: int(random.integers(1, len(frame)))]
            case "mutate":
                bit = int(random.integers(8 * len(frame)))
                return _flipped(frame, [bit])
            case "header":
                # function and byte count, or the first byte of an echo
                before = len(frame) - len(self.framing.unit(frame)) - self.framing.trailer + 2
                return _flipped(frame, [int(random.integers(8 * before))])
            case "noise":
                hits = np.flatnonzero(random.random(8 * len(frame)) < self._bit_rate)
                return _flipped(frame, hits.tolist())
            case "garbage":
                return random.bytes(int(random.integers(1, 9))) + frame
            case "transaction":
                return _flipped(frame, [int(random.integers(16))])
            case "protocol":
                return _flipped(frame, [16 + int(random.integers(16))])
            case "unit":
                return self.framing.with_address(frame)
        return self.framing.rebuild(frame, self._wrong(self.framing.unit(frame)))

    def _wrong(self, unit: bytes) -> bytes:
        """Return a well-formed reply that is wrong."""
        if self._kind == "exception":
            return bytes((unit[0] | 0x80, int(self._random.integers(1, 7))))
        if self._kind == "function":
            others = [code for code in (3, 4, 6, 16, 23) if code != unit[0]]
            return bytes((int(self._random.choice(others)),)) + unit[1:]
        if self._kind == "count":
            return _other_count(unit, longer=bool(self._random.integers(2)))
        if self._kind == "echo" and unit[0] in ECHOED:
            return _flipped(unit, [8 + int(self._random.integers(8 * (len(unit) - 1)))])
        if self._kind == "word-swap":
            return _swapped(unit)
        return unit


def _flipped(data: bytes, bits: list[int]) -> bytes:
    changed = bytearray(data)
    for bit in bits:
        changed[bit // 8] ^= 0x80 >> bit % 8
    return bytes(changed)


def _other_count(unit: bytes, *, longer: bool) -> bytes:
    """Return a reply with one register more or less, its byte count made to fit."""
    counted = unit[0] in COUNTED
    data = unit[2:] if counted else unit[1:]
    data = data + b"\0\1" if longer or len(data) < 4 else data[:-2]
    return bytes((unit[0], len(data) & 0xFF)) + data if counted else unit[:1] + data


def _swapped(unit: bytes) -> bytes:
    """Return a reply with the words of every pair of registers exchanged."""
    at = 2 if unit[0] in COUNTED else 1
    data = unit[at:]
    pairs = len(data) // 4 * 4
    swapped = b"".join(data[n + 2 : n + 4] + data[n : n + 2] for n in range(0, pairs, 4))
    return unit[:at] + swapped + data[pairs:]


Spoil = Callable[[list[bytes], int, np.random.Generator], list[bytes]]
"""Makes a fault at one packet of a stream."""


def flipped(packet: bytes, first: int, random: np.random.Generator) -> bytes:
    """Return a packet with one bit changed, from byte `first` on."""
    return _flipped(packet, [int(random.integers(8 * first, 8 * len(packet)))])


def _cut(packet: bytes, random: np.random.Generator) -> bytes:
    at, size = int(random.integers(1, len(packet) - 9)), int(random.integers(1, 9))
    return packet[:at] + packet[at + size :]


def _longer(packet: bytes, random: np.random.Generator) -> bytes:
    at = int(random.integers(1, len(packet)))
    return packet[:at] + random.bytes(int(random.integers(1, 9))) + packet[at:]


PACKET_FAULTS: dict[str, Spoil] = {
    "bytes missing": lambda p, n, r: [*p[:n], _cut(p[n], r), *p[n + 1 :]],
    "bytes inserted": lambda p, n, r: [*p[:n], _longer(p[n], r), *p[n + 1 :]],
    "packet dropped": lambda p, n, r: p[:n] + p[n + 1 :],
    "two packets dropped": lambda p, n, r: p[:n] + p[n + 2 :],
    "packet twice": lambda p, n, r: [*p[: n + 1], p[n], *p[n + 1 :]],
    "packets swapped": lambda p, n, r: [*p[:n], p[n + 1], p[n], *p[n + 2 :]],
    "packet from before": lambda p, n, r: [*p[:n], p[n - 2], *p[n + 1 :]],
}
"""What can happen to the packets of any stream."""
