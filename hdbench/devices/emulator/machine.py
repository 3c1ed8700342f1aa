"""Acquisition of the emulated node: sampling, motion, watchdog, sample buffer and block window."""

from __future__ import annotations

import struct
import zlib
from collections import deque
from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.node import registers as reg
from hdbench.devices.node.blocks import CRC_AT, DATA_AT, HEADER
from hdbench.devices.registers import BLOCK_DATA_REGISTERS, Value
from hdbench.plant.bench import SimulatedBench
from hdbench.profile.schema import ReferenceWave
from hdbench.profile.waves import ReferenceProgram

# four seconds at 1 kHz: twice the longest watchdog time
FIFO_SCANS = 4096
# values come as 32-bit floats, rounded by at most 6e-8 of their size
ROUNDING = 1e-6
# four codes and a 32-bit encoder: what the node keeps of a scan
SCAN_BYTES = 12
_WINDOW_BYTES = DATA_AT + 2 * BLOCK_DATA_REGISTERS
Pace = Literal["realtime", "fast"]
Record = Callable[[Mapping[str, object]], None]
# idle time is made up in steps of at most this many samples, so that a long sleep costs nothing
_MAX_IDLE_SAMPLES = 1000
# fast pace: device time produced at once, kept below the time in which a host reacts
_FAST_CHUNK_S = 0.2
_FAST_CHUNK_BLOCKS = 10
# fast pace: device time that passes per look at a motor that is still turning
_FAST_IDLE_S = 0.02
_OVERFLOW, _RUNNING = int(reg.Flag.OVERFLOW), int(reg.Flag.RUNNING)
_TRIPPED, _ENABLED = int(reg.Flag.WATCHDOG_TRIPPED), int(reg.Flag.DRIVE_ENABLED)


def reference_wave(values: Mapping[str, Value]) -> ReferenceWave | None:
    """Return the wave that a checked parameter block means."""
    code = int(values["wave"])
    if code in (0, reg.PROGRAM_WAVE):
        return None
    numbers = {name: float(values[name]) for name in reg.WAVE_NUMBERS}
    duty, rise, fall = (numbers[name] for name in ("duty", "rise", "fall"))
    if reg.WAVES[code] == "trapezoid" and 0.0 < rise + duty + fall - 1.0 <= ROUNDING:
        numbers["duty"] = 1.0 - rise - fall
    return ReferenceWave.model_validate({"wave": reg.WAVES[code], **numbers})


class BlockHeader(NamedTuple):
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
    run, seq, flags, depth, first_index, channels = header
    flags |= channels << 8
    head = HEADER.pack(0, run, seq, flags, len(whole), depth, first_index, encoder, 0)
    return (head + whole[:, columns].tobytes()).ljust(_WINDOW_BYTES, b"\0")


def seal_block(window: bytes, echo: int) -> bytes:
    """Return the window of `encode_block` with echo and checksum."""
    body = struct.pack(">H", echo) + window[2:CRC_AT]
    data = window[DATA_AT : DATA_AT + 2 * body[6].bit_count() * int.from_bytes(body[8:10], "big")]
    return body + struct.pack(">I", zlib.crc32(data, zlib.crc32(body))) + window[DATA_AT:]


class ScanFifo:
    """Scans waiting to be read, in runs of adjacent indices.

    Parameters
    ----------
    capacity : int
        Scans that fit.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._runs: deque[tuple[int, bytearray]] = deque()
        self.clear()

    def clear(self) -> None:
        """Forget everything and count from zero."""
        self._runs.clear()
        self.depth = self.taken = self.lost = self.next_out = 0

    def append(self, scans: bytes) -> None:
        """Add new scans; those that do not fit are counted in `lost`."""
        count = len(scans) // SCAN_BYTES
        kept = min(count, self._capacity - self.depth)
        if kept:
            last = self._runs[-1] if self._runs else None
            if last is None or last[0] + len(last[1]) // SCAN_BYTES != self.taken:
                last = (self.taken, bytearray())
                self._runs.append(last)
            last[1].extend(scans[: kept * SCAN_BYTES])
        self.depth += kept
        self.lost += count - kept
        self.taken += count

    def take(self, count: int) -> tuple[int, bytes]:
        """Remove up to `count` adjacent scans."""
        if not self._runs:
            self.next_out = self.taken
            return self.taken, b""
        first, data = self._runs.popleft()
        with memoryview(data) as waiting:
            scans = bytes(waiting[: count * SCAN_BYTES])
        del data[: count * SCAN_BYTES]
        taken = len(scans) // SCAN_BYTES
        if data:
            self._runs.appendleft((first + taken, data))
        self.depth -= taken
        self.next_out = first + taken
        return first, scans


class NodeMachine:
    """One node with its bench.

    Parameters
    ----------
    bench : SimulatedBench
        The simulated bench.
    pace : {"realtime", "fast"}
        Samples by the wall clock, or as fast as the host reads them.
    clock : callable
        Monotonic clock, s.
    record : callable
        Takes one mapping per change of state and while the motor turns.
    """

    def __init__(
        self, bench: SimulatedBench, *, pace: Pace, clock: Callable[[], float], record: Record
    ) -> None:
        self.bench = bench
        self.state = reg.State.IDLE
        self.fifo = ScanFifo(FIFO_SCANS)
        self.starts = self.trips = self.encoder_count = 0
        self.channels = reg.ALL_CHANNELS
        self.device_s = self.mark_start_s = self.mark_stop_s = 0.0
        self._pace = pace
        self._clock = clock
        self._record = record
        self._period_s = 1e-3
        self._n_samples = 0
        self._watchdog_s = 0.0
        self._fed_s = self._started_s = self._ticked_s = clock()

    @property
    def busy(self) -> bool:
        """Whether an acquisition runs or the motor is not at a standstill yet."""
        return self.state == reg.State.RUNNING or self.bench.enabled

    @property
    def block_scans(self) -> int:
        """Scans of a full block with the channels chosen."""
        return reg.block_scans(self.channels.bit_count())

    def start(
        self, parameters: Mapping[str, Value], program: ReferenceProgram | None = None
    ) -> None:
        """Start an acquisition from a checked parameter block and arm the watchdog."""
        wave = reference_wave(parameters) if program is None else program
        self._period_s = 1e-9 * int(parameters["sample_period_ns"])
        self._n_samples = int(parameters["n_samples"])
        self._watchdog_s = 1e-3 * int(parameters["watchdog_ms"])
        self.channels = int(parameters["channels"]) or reg.ALL_CHANNELS
        self.fifo.clear()
        self.bench.begin(
            sample_period_s=self._period_s, wave=wave, duration_s=self._n_samples * self._period_s
        )
        self.starts = (self.starts + 1) % 0x10000
        self.mark_start_s = self.mark_stop_s = self.device_s
        self._fed_s = self._started_s = self._ticked_s = self._clock()
        self.state = reg.State.RUNNING
        self._note("start")

    def end(self, state: reg.State) -> None:
        """End the acquisition, if one runs, and bring the motor to a standstill in any case."""
        self.bench.halt()
        if self.state == reg.State.RUNNING:
            self.state = state
            self.mark_stop_s = self.device_s
            self._ticked_s = self._clock()
            self._note(state.name.lower())

    def feed_watchdog(self) -> None:
        """Note a sign of life of the host."""
        self._fed_s = self._clock()

    def rearm(self) -> None:
        """Clear a latched trip."""
        if self.state != reg.State.RUNNING:
            self.state = reg.State.IDLE

    def tick(self) -> None:
        """Let the wall clock act: watchdog, samples in real time, deceleration."""
        now_s = self._clock()
        if self.state == reg.State.RUNNING:
            if self._pace == "realtime":
                due = int((now_s - self._started_s) / self._period_s) + 1 - self.fifo.taken
                self._produce(due)
            if self.state == reg.State.RUNNING and now_s - self._fed_s > self._watchdog_s:
                self.trips += 1
                self.end(reg.State.TRIPPED)
            return
        self._idle(int((now_s - self._ticked_s) / self._period_s))

    def look(self) -> None:
        """Let device time pass for one look at the status, in the fast pace."""
        if self._pace == "fast" and self.state != reg.State.RUNNING:
            self._idle(max(1, round(_FAST_IDLE_S / self._period_s)))

    def produce_ahead(self) -> None:
        """In the fast pace, fill the buffer by a chunk when it holds less than one."""
        if self._pace == "fast" and self.state == reg.State.RUNNING:
            most = _FAST_CHUNK_BLOCKS * self.block_scans
            chunk = int(np.clip(_FAST_CHUNK_S / self._period_s, self.block_scans, most))
            if self.fifo.depth < chunk:
                self._produce(chunk)

    def block_is_due(self) -> bool:
        """Return whether a block is full, old enough, or the last one."""
        age = self.fifo.taken - self.fifo.next_out
        # 50 ms: what a person watching does not notice
        full = age >= self.block_scans
        return self.state != reg.State.RUNNING or full or age * self._period_s >= 0.05

    def flags(self) -> int:
        """Return the flags of this moment."""
        return (
            (_OVERFLOW if self.fifo.lost else 0)
            | (_RUNNING if self.state == reg.State.RUNNING else 0)
            | (_TRIPPED if self.state == reg.State.TRIPPED else 0)
            | (_ENABLED if self.bench.enabled else 0)
        )

    def _produce(self, count: int) -> None:
        count = min(count, self._n_samples - self.fifo.taken)
        if count > 0:
            samples = self.bench.advance(count)
            self.device_s += count * self._period_s
            self.encoder_count = int(samples.encoder_count[-1])
            self.fifo.append(encode_scans(samples.codes, samples.encoder_count))
            self._note("sampling")
        if self.fifo.taken >= self._n_samples:
            self.end(reg.State.FINISHED)

    def _idle(self, count: int) -> None:
        """Let the bench go on without an acquisition, as long as the motor turns."""
        if count < 1:
            return
        self._ticked_s = self._clock()
        self.device_s += count * self._period_s
        if not self.bench.enabled:
            return
        samples = self.bench.advance(min(count, _MAX_IDLE_SAMPLES))
        self.encoder_count = int(samples.encoder_count[-1])
        self._note("slowing" if self.bench.enabled else "standstill")

    def _note(self, event: str) -> None:
        self._record(
            {
                "event": event,
                "monotonic_s": self._clock(),
                "device_s": self.device_s,
                "state": self.state.name.lower(),
                "reference_v": self.bench.reference_v,
                "velocity_rad_s": self.bench.velocity_rad_s,
                "samples_taken": self.fifo.taken,
                "samples_lost": self.fifo.lost,
                "watchdog_trips": self.trips,
            }
        )


class BlockWindow:
    """Forms blocks from the sample buffer of `machine`.

    Parameters
    ----------
    machine : NodeMachine
        The node's acquisition.
    """

    def __init__(self, machine: NodeMachine) -> None:
        self._machine = machine
        self.clear()

    def clear(self) -> None:
        """Forget the block and number the next one 1."""
        self._block: bytes | None = None
        self._seq = 0
        self.scans = 0

    def acknowledge(self, seq: int) -> None:
        """Let go of the block if `seq` is its number; any other number changes nothing."""
        if self._block is not None and seq == self._seq:
            self._block = None
            self.scans = 0

    def image(self, echo: int) -> bytes:
        """Return the block that waits for its acknowledgement, or form the next one."""
        if self._block is None:
            self._block = self._next()
        if self._block is not None:
            return seal_block(self._block, echo)
        return seal_block(encode_block(self._header(0, 0, self._machine.fifo.next_out), b""), echo)

    def _header(self, seq: int, depth: int, first_index: int) -> BlockHeader:
        machine = self._machine
        return BlockHeader(
            machine.starts, seq, machine.flags(), depth, first_index, machine.channels
        )

    def _next(self) -> bytes | None:
        machine = self._machine
        if machine.fifo.depth < machine.block_scans:
            machine.produce_ahead()
        ended = machine.state != reg.State.RUNNING
        lost_at_the_end = ended and machine.fifo.next_out < machine.fifo.taken
        if not (machine.block_is_due() and (machine.fifo.depth or lost_at_the_end)):
            return None
        first_index, scans = machine.fifo.take(machine.block_scans)
        self._seq = self._seq % 0xFFFF + 1
        self.scans = machine.fifo.next_out - first_index
        # losses that no later scan will show count as one more to come
        untold = ended and machine.fifo.next_out < machine.fifo.taken
        depth = max(machine.fifo.depth, int(untold))
        return encode_block(self._header(self._seq, min(depth, 0xFFFF), first_index), scans)
