"""An emulated DATAQ instrument on a pseudo-terminal, with its scan clock and small buffer."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.emulator.instrument import ElectricalSamples, SimulatedInstrument, Terminal
from hdbench.devices.emulator.serving import Emulation, EmulatorSettings
from hdbench.drivers.dataq.driver import EMULATOR_NAME
from hdbench.drivers.dataq.scans import BUFFER_SAMPLES, MODELS, Model
from hdbench.drivers.dataq.table import DataqAcquisition
from hdbench.plant.converter import to_code
from hdbench.system.lines import PseudoTerminal

# D6 to D0 open are pulled up; D1 and D0 come inverted in the lower byte
OPEN_LINES = 0x7F
_FULL = 32768
_ANALOG, _DIGITAL, _COUNTER = range(8), 8, 10


def scan_words(
    samples: ElectricalSamples,
    entries: tuple[int, ...],
    model: Model,
    wiring: Mapping[int, Terminal],
    lines: int = OPEN_LINES,
    edges: NDArray[np.int64] | None = None,
) -> NDArray[np.int16]:
    """Return the scans of a list as they stand in the stream."""
    ranges = {code: range_v for range_v, code in model.ranges.items()}
    columns = []
    for entry in entries:
        kind = entry & 0xF
        if kind in _ANALOG:
            name, factor = wiring.get(kind, ("torque", 0.0))
            volts = samples.volts[name] * factor
            columns.append(to_code(volts, ranges.get(entry >> 8, 10.0), model.bits))
        elif kind == _COUNTER and edges is not None:
            columns.append((edges % 65536 - _FULL).astype(np.int16))
        else:
            constant = lines << 8 | ~lines & 3 if kind == _DIGITAL else -_FULL & 0xFFFF
            columns.append(np.full(len(samples), constant, dtype=np.uint16).astype(np.int16))
    words = np.column_stack(columns).astype(np.int16)
    if not model.digital:
        words[:, 0] |= lines & 3
    return words


_OVERFLOW = b"stop 01"
_FIRMWARE = "87"
_INFO = {0: "DATAQ", 2: _FIRMWARE, 5: EMULATOR_NAME}
# one line of the encoder has one rising edge in four counts
_COUNTS_PER_EDGE = 4
# numbers that a host may set, with what they are when it is switched on
_NUMBERS = {"ps": 0, "encode": 0, "eol": 0, "srate": 375, "dec": 1, "deca": 1, "led": 0, "ffl": 32}
_SILENT = ("endo", "dout", "reset", "filter")


@dataclass(eq=False)
class DataqDevice:
    """One instrument."""

    instrument: SimulatedInstrument
    model: Model
    wiring: Mapping[int, Terminal]
    serial: str

    def __post_init__(self) -> None:
        self.lines = OPEN_LINES
        self.buffer_samples = BUFFER_SAMPLES
        self._numbers = dict(_NUMBERS)
        self._entries: dict[int, int] = {}
        self.scanning = self._average = False
        self._stream = b""
        self._edges = 0
        self._pulse: int | None = None

    def command(self, line: str) -> bytes:
        """Carry out one command and return what it sends back."""
        word, _, rest = line.partition(" ")
        if word == "start":
            self._start()
            return b""
        if word == "stop":
            left = b""
            if self.scanning:
                self._stream += self._sampled()
                left = self._end()
            return left + b"stop\r"
        if self.scanning:
            # settings are taken, not echoed, while it streams
            self._obey(word, rest)
            return b""
        value = self._obey(word, rest)
        return f"{line} {value}\r".encode() if value else f"{line}\r".encode()

    def tick(self, *, blocked: bool = False) -> bytes:
        """Let time pass; return packets that are full, none while the line is blocked."""
        self.instrument.catch_up()
        if not self.scanning:
            return b""
        self._stream += self._sampled()
        if blocked:
            most = 2 * self.buffer_samples
            # as with a full buffer: the last bytes say so
            return self._end()[:most] + _OVERFLOW if len(self._stream) > most else b""
        size = 16 << self._numbers["ps"]
        whole = len(self._stream) // size * size
        packets, self._stream = self._stream[:whole], self._stream[whole:]
        return packets

    def _obey(self, word: str, rest: str) -> str:
        """Carry out a setting or a question; return its value."""
        if word == "info":
            item = int(rest) if rest.isdecimal() else -1
            return {**_INFO, 1: self.model.number, 6: self.serial}.get(item, "0")
        if word == "*IDN?":
            return f"DATAQ,{self.model.number},{self.serial},{_FIRMWARE}"
        if word == "slist":
            position, _, entry = rest.partition(" ")
            if position == "0":
                self._entries.clear()
            self._entries[int(position)] = int(entry)
        elif word in _NUMBERS and rest.isdecimal():
            self._numbers[word] = int(rest)
        elif word == "filter":
            self._average = rest.split()[-1:] == ["1"]
        elif word == "din":
            return str(self.lines)
        return "" if word in (*_NUMBERS, *_SILENT, "slist", "filter") else "unknown"

    def _start(self) -> None:
        if self.scanning or not self._entries:
            return
        entries = len(self._entries)
        numbers = self._numbers
        division = numbers["srate"] * numbers["dec"] * numbers["deca"]
        averaged = numbers["dec"] if self._average else 1
        self.instrument.begin(division / averaged / self.model.clock_hz(entries))
        self.scanning, self._stream = True, b""

    def _end(self) -> bytes:
        """Stop, and return what the buffer still held."""
        self.instrument.end()
        self.scanning = False
        left, self._stream = self._stream, b""
        return left

    def _count_edges(self, count: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the edges of one encoder line since it was switched on, in either direction."""
        pulses = count // _COUNTS_PER_EDGE
        first = int(pulses[0]) if self._pulse is None else self._pulse
        edges: NDArray[np.int64] = self._edges + np.cumsum(np.abs(np.diff(pulses, prepend=first)))
        self._edges, self._pulse = int(edges[-1]), int(pulses[-1])
        return edges

    def _sampled(self) -> bytes:
        """Return the bytes of every scan whose time has come."""
        averaged = self._numbers["dec"] if self._average else 1
        count = self.instrument.due() // averaged * averaged
        if not count:
            return b""
        samples = self.instrument.take(count)
        entries = tuple(self._entries[at] for at in sorted(self._entries))
        edges = self._count_edges(samples.count)
        words = scan_words(
            _averaged(samples, averaged),
            entries,
            self.model,
            self.wiring,
            self.lines,
            edges[averaged - 1 :: averaged],
        )
        return words.astype("<i2").tobytes()


def _averaged(samples: ElectricalSamples, number: int) -> ElectricalSamples:
    """Return the means of so many samples each."""
    if number == 1:
        return samples
    volts = {
        name: np.mean(values.reshape(-1, number), axis=1) for name, values in samples.volts.items()
    }
    return ElectricalSamples(
        samples.first_index // number, volts, samples.count[number - 1 :: number]
    )


# wall-clock grain of the stream, s
_TICK_S = 0.005
# fast pace: a host has less time for the same samples
_FAST_BUFFERS = 16


class EmulatedDataq:
    """Implements `hdbench.devices.emulator.serving.EmulatedDevice` on a pseudo-terminal."""

    def __init__(self, device: DataqDevice) -> None:
        self.device = device
        self._line: PseudoTerminal | None = None
        self._buffer = self._left = b""
        self._timer: asyncio.TimerHandle | None = None

    async def open(self, settings: EmulatorSettings) -> Mapping[str, object]:
        """Open the pseudo-terminal and return ``address``; it has no port to choose."""
        if settings.pace == "fast":
            self.device.buffer_samples *= _FAST_BUFFERS
        self._line = PseudoTerminal(self._received)
        self._tick()
        return {"address": f"serial://{self._line.path}"}

    def close(self) -> None:
        """End the line."""
        if self._timer is not None:
            self._timer.cancel()
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def _tick(self) -> None:
        self._left = self._send(self._left)
        self._left += self.device.tick(blocked=bool(self._left))
        self._left = self._send(self._left)
        self._timer = asyncio.get_running_loop().call_later(_TICK_S, self._tick)

    def _received(self, data: bytes) -> None:
        self._buffer += data
        *lines, self._buffer = self._buffer.split(b"\r")
        for line in lines:
            self._left += self.device.command(line.decode("ascii", errors="replace").strip())
        self._left = self._send(self._left)

    def _send(self, data: bytes) -> bytes:
        """Send what the line takes; return the rest."""
        while data and self._line is not None and (sent := self._line.write(data)):
            data = data[sent:]
        return data


def emulate_dataq(emulation: Emulation, table: DataqAcquisition) -> EmulatedDataq:
    """Return an instrument with a simulated bench at the terminals that `table` names."""
    wiring = emulation.terminals(table.channels)
    serial = f"{emulation.seed % 16**8:08X}"
    return EmulatedDataq(DataqDevice(emulation.instrument, MODELS[table.model], wiring, serial))
