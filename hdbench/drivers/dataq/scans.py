"""Scan list with its mark, words to volts and counts, and the acquisition of their stream."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.base import WAIT_S, StreamedAcquisition
from hdbench.devices.daq import Role, ScanBlock
from hdbench.drivers.dataq.port import Port
from hdbench.drivers.dataq.table import DataqAcquisition, DataqChannel
from hdbench.errors import DeviceError, ProfileError
from hdbench.records.trace import FloatArray
from hdbench.system.files import packaged_toml


@dataclass(frozen=True, slots=True)
class Model:
    """One model."""

    number: str
    ranges: Mapping[float, int]
    dividend: float = 60e6
    srate_min: int = 375
    srate_max: int = 65535
    dec_max: int = 512
    deca_max: int = 40000
    throughput: bool = False
    bits: int = 16
    digital: bool = True
    srate_step: int = 0
    single_dividend: float = 0.0

    def shortest(self, entries: int) -> int:
        """Return the smallest srate with a list of so many entries."""
        return self.srate_min + self.srate_step * (entries - 1)

    def clock_hz(self, entries: int) -> float:
        """Return the dividend, Hz, for the rate of each of so many entries."""
        dividend = self.single_dividend if entries == 1 and self.single_dividend else self.dividend
        return dividend / entries if self.throughput else dividend


def _models() -> dict[str, Model]:
    models = {}
    for name, keys in packaged_toml(__package__, "models.toml").items():
        ranges = dict(keys.pop("ranges", [(10.0, 0)]))
        models[name] = Model(name.removeprefix("DI-"), ranges, **keys)
    return models


MODELS: Mapping[str, Model] = _models()


# times in a trace are counts of the period: 100 ppm are 60 ms in ten minutes
_TOLERANCE = 1e-4
# a packet leaves the device only when it is full; data are not to be older than this, s
_PACKET_S = 0.025
_LARGEST_CODE = 7
# the device's buffer holds this many samples; it must bridge this time, s, for a host to follow
BUFFER_SAMPLES = 1024
_BUFFER_S = 0.05
_TRIES = 200


@dataclass(frozen=True, slots=True)
class RateSetting:
    """What is written."""

    srate: int
    dec: int
    deca: int
    period_s: float


def choose_rate(model: Model, entries: int, period_s: float, average: int) -> RateSetting:
    """Return the numbers for a sampling period."""
    total = model.clock_hz(entries) * period_s
    # averaging needs its own dec; else few are enough, where deca goes on from there
    decs = [average] if average > 1 else list(range(1, model.dec_max + 1))
    if model.deca_max > 1:
        decs = decs[:_TRIES]
    best: RateSetting | None = None
    for found in _settings(model, entries, total, decs):
        if best is None or abs(found.period_s - period_s) < abs(best.period_s - period_s):
            best = found
        if abs(best.period_s - period_s) < 1e-12 * period_s:
            break
    if (
        average > model.dec_max
        or best is None
        or (not abs(best.period_s - period_s) <= _TOLERANCE * period_s)
    ):
        low, high = lowest_rate_hz(model, entries), highest_rate_hz(model, entries, average)
        raise DeviceError(
            f"a DI-{model.number} with {entries} entries in its scan list and {average} "
            f"conversions per sample has no period of {period_s:.6g} s",
            where="key daq.sample_period_s",
            fix=f"its rates are {model.clock_hz(entries):g} / (srate dec deca) Hz, {low:.3g} to "
            f"{high:.4g} Hz: choose one of them",
        )
    return best


def highest_rate_hz(model: Model, entries: int, average: int = 1) -> float:
    """Return the highest rate at which the device's buffer still bridges 50 ms."""
    rate = model.clock_hz(entries) / (model.shortest(entries) * average)
    return min(rate, BUFFER_SAMPLES / (entries * _BUFFER_S))


def lowest_rate_hz(model: Model, entries: int) -> float:
    """Return the lowest rate."""
    return model.clock_hz(entries) / (model.srate_max * model.dec_max * model.deca_max)


def packet_code(entries: int, period_s: float) -> int:
    """Return n of the packet size 16 * 2**n bytes: the largest that fills within 25 ms."""
    n_bytes = 2.0 * entries * _PACKET_S / period_s
    return max(0, min(math.floor(math.log2(n_bytes / 16.0)), _LARGEST_CODE))


def _settings(model: Model, entries: int, total: float, decs: list[int]) -> Iterator[RateSetting]:
    """Yield numbers whose product is near `total`."""
    for dec in decs:
        first = max(1, math.ceil(total / (dec * model.srate_max)))
        for deca in range(first, min(first + _TRIES, model.deca_max + 1)):
            srate = round(total / (dec * deca))
            if model.shortest(entries) <= srate <= model.srate_max:
                period_s = srate * dec * deca / model.clock_hz(entries)
                yield RateSetting(srate, dec, deca, period_s)


_COUNTER_WRAP = 2**16
# what the driver gives out, like a 32-bit quadrature counter
WRAP = 2**32


class SignedCounter:
    """Turns a counter's edges into a position.

    position(k) = position(k - 1) + sign(tacho(k - 1) + tacho(k)) * edges(k) * counts_per_edge

    Here edges(k) is the number of edges since sample k - 1, modulo 2**16. Where the motor turns
    round between two samples, the sum of the tacho's readings has the sign of the larger part of
    the way. An edge of the smaller part gets the wrong sign, and the position is off by two edges
    until another one makes up for it. The position is in the middle of what an edge leaves open,
    half of `counts_per_edge`.
    """

    def __init__(self, counts_per_edge: int) -> None:
        self._counts_per_edge = counts_per_edge
        self._last: int | None = None
        self._last_tacho = 0.0
        self._position = counts_per_edge // 2

    def __call__(self, edges: FloatArray, tacho: FloatArray) -> FloatArray:
        """Return the position at the next samples."""
        if not len(edges):
            return edges
        counts = edges.astype(np.int64)
        first = int(counts[0]) if self._last is None else self._last
        steps = np.diff(counts, prepend=first) % _COUNTER_WRAP
        way = tacho + np.concatenate(([self._last_tacho], tacho[:-1]))
        moved = np.where(way < 0.0, -steps, steps) * self._counts_per_edge
        self._last_tacho = float(tacho[-1])
        positions = self._position + np.cumsum(moved)
        self._last, self._position = int(counts[-1]), int(positions[-1])
        wrapped: FloatArray = (positions % WRAP).astype(np.float64)
        return wrapped


# a rate input needs the code of a range, the first of them 50 kHz
_DIGITAL, _COUNTER, _RATE = 8, 10, 0x0109
_ENTRIES_MAX = 11
# the digital word: inverted D1, D0 in byte 1, D6 to D0 in byte 2; all other bits are zero
_DIGITAL_MASK = 0x7F03
_FULL = 32768


@dataclass(frozen=True, slots=True)
class Marker:
    """What tells where a scan ends."""

    position: int
    mask: int
    zeros: int


@dataclass(frozen=True, slots=True)
class ScanPlan:
    """Scan list and scales of one acquisition."""

    words: tuple[int, ...]
    marker: Marker
    scales: tuple[float, ...]
    bits: int
    counter: int | None = None

    @property
    def scan_bytes(self) -> int:
        """Bytes of a scan."""
        return 2 * len(self.words)

    def decode(self, words: NDArray[np.int16]) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return values in the units of their roles, and which of them sit at an end."""
        step = 1 << (16 - self.bits)
        analog = words[:, : len(self.scales)].astype(np.int32) & -step
        saturated = (analog <= -_FULL) | (analog >= _FULL - step)
        values = analog * np.array(self.scales)
        if self.counter is not None:
            values[:, self.counter] = words[:, self.counter].astype(np.int32) + _FULL
            saturated[:, self.counter] = False
        return values, saturated


def plan_scan(table: DataqAcquisition, roles: tuple[Role, ...]) -> ScanPlan:
    """Return scan list, marker and scales of some channels.

    The stream has no headers, counters or checksums, so a scan carries a mark of its own: the
    digital inputs, wired to nothing, as its last word. Packets have 2**n bytes. So that the loss of
    one of them is never the loss of whole scans, a scan never has 2**n words: where it would, the
    rate input, wired to nothing either, stands before the mark.
    """
    model = MODELS[table.model]
    channels = {channel.role: channel for channel in table.channels}
    chosen = [channels[role] for role in roles]
    codes = [_word(model, channel) for channel in chosen]
    scales = tuple(channel.scale * channel.range_v / _FULL for channel in chosen)
    counter = roles.index("encoder") if "encoder" in roles else None
    if not model.digital:
        # D1 and D0 come in the lowest bits of the first word, the others end in zeros
        return ScanPlan(tuple(codes), Marker(0, 0x0003, 0x000C), scales, model.bits)
    extra = [_DIGITAL] if (len(codes) + 1) & len(codes) else [_RATE, _DIGITAL]
    words = (*codes, *extra)
    if len(words) > _ENTRIES_MAX:
        raise ProfileError(
            f"{len(words)} entries with the mark; the scan list holds {_ENTRIES_MAX}",
            where="key daq.channels",
            fix="name fewer channels",
        )
    marker = Marker(len(words) - 1, 0xFFFF, 0xFFFF & ~_DIGITAL_MASK)
    return ScanPlan(words, marker, scales, model.bits, counter)


def _word(model: Model, channel: DataqChannel) -> int:
    """Return the scan-list word of a channel."""
    if (channel.role == "encoder") != (channel.input == "counter") or (
        channel.role == "encoder" and not model.digital
    ):
        raise ProfileError(
            f"{channel.role} on {channel.input!r}; an encoder needs the counter of a model that "
            "has one, everything else an analog input",
            where="key daq.channels",
            fix="correct the input, or leave the encoder out: the motor angle is then integrated "
            "from the tacho",
        )
    if channel.input == "counter":
        return _COUNTER
    if channel.range_v not in model.ranges:
        known = ", ".join(f"{value:g}" for value in model.ranges)
        raise ProfileError(
            f"range_v {channel.range_v:g} V; a DI-{model.number} has {known} V",
            where="key daq.channels",
            fix="choose one of its ranges",
        )
    return channel.number | model.ranges[channel.range_v] << 8


# what a device whose buffer ran over sends last
OVERFLOW = b"stop 01"


class StreamFault(Exception):  # noqa: N818 - told by the driver as a DeviceError
    """The stream cannot be trusted from here on."""


class ScanAssembler:
    """Cuts a stream into scans and checks the mark of each.

    A scan counts only when its mark is that of the first scan, so the bytes before it are complete:
    a byte too many or too few moves another byte into the mark's place. The digital word cannot be
    mistaken for itself moved by one byte, because its two bytes differ in D1 and D0; moved by whole
    words, an analog word would have to read exactly as the mark does (+9.92 V of 10 V, where the
    inputs are open).
    """

    def __init__(self, plan: ScanPlan) -> None:
        self.delivered = 0
        self._plan = plan
        self._rest = b""
        self._mark: int | None = None

    @property
    def overflowed(self) -> bool:
        """Whether the stream ends as that of a device whose buffer ran over."""
        return self._rest.rstrip(b"\r\n\0").endswith(OVERFLOW)

    def take(self, data: bytes) -> NDArray[np.int16]:
        """Return the whole scans that `data` completes."""
        self._rest += data
        size = self._plan.scan_bytes
        count = len(self._rest) // size
        raw = np.frombuffer(self._rest, dtype="<i2", count=count * len(self._plan.words))
        scans = raw.reshape(count, len(self._plan.words)).astype(np.int16)
        good = self._good(scans)
        if not good and count:
            raise StreamFault(self._why(scans[0]))
        self._rest = self._rest[good * size :]
        self.delivered += good
        return scans[:good]

    def _good(self, scans: NDArray[np.int16]) -> int:
        """Return how many scans from the first on have the right mark."""
        marker = self._plan.marker
        words = scans.astype(np.int32) & 0xFFFF
        marks = words[:, marker.position] & marker.mask
        if self._mark is None and len(marks) and self._fit(int(words[0, marker.position])):
            self._mark = int(marks[0])
        right = marks == (-1 if self._mark is None else self._mark)
        right &= words[:, marker.position] & marker.zeros == 0
        if marker.position == 0:
            # words that follow the marked one end in zeros down to the resolution
            below = (1 << (16 - self._plan.bits)) - 1
            right &= np.all(words[:, 1:] & below == 0, axis=1)
        return int(np.argmin(right)) if not np.all(right) else len(right)

    def _fit(self, word: int) -> bool:
        """Return whether a word can be the mark of a scan."""
        marker = self._plan.marker
        if word & marker.zeros:
            return False
        if marker.position == 0:
            return word & marker.mask != 0
        return word >> 8 != word & 0xFF

    def _why(self, scan: NDArray[np.int16]) -> str:
        found = int(scan[self._plan.marker.position]) & 0xFFFF
        if self._mark is None:
            return f"the first scan is marked 0x{found:04X}, which no open digital inputs read"
        return (
            f"scan {self.delivered} is marked 0x{found:04X}, the first one 0x{self._mark:04X}: "
            "bytes are missing or too many, or a digital input has changed"
        )


# reads whose earliest arrival counts as "now"; clocks of host and device differ by less than this
_WINDOW = 64
_CLOCKS = 2e-4


class LagWatch:
    """Finds whole scans that are missing: those that came fall behind the host's clock."""

    def __init__(self, period_s: float, limit_s: float) -> None:
        self._period_s = period_s
        self._limit_s = limit_s
        self._lags: deque[float] = deque(maxlen=_WINDOW)
        self._least_s = math.inf
        self._start_s: float | None = None

    def missing(self, delivered: int, read_s: float) -> int:
        """Note that so many scans had come by `read_s`; return how many seem to be missing."""
        if self._start_s is None:
            self._start_s = read_s
        lag_s = read_s - delivered * self._period_s
        self._lags.append(lag_s)
        self._least_s = min(self._least_s, lag_s)
        behind_s = min(self._lags) - self._least_s
        allowed_s = self._limit_s + _CLOCKS * (read_s - self._start_s)
        return round(behind_s / self._period_s) if behind_s > allowed_s else 0


class Acquisition(StreamedAcquisition):
    """One acquisition of the instrument."""

    def __init__(
        self,
        plan: ScanPlan,
        period_s: float,
        packet_s: float,
        n_samples: int,
        *,
        encoder: tuple[int, int] | None = None,
    ) -> None:
        super().__init__(n_samples, packet_s)
        self._counter = None if encoder is None else SignedCounter(encoder[0])
        self._tacho = 0 if encoder is None else encoder[1]
        self.period_s = period_s
        self._plan = plan
        self._scans = ScanAssembler(plan)
        # packets have 2**n bytes, scans an odd number of words: the fewest lost packets that are
        # whole scans are as many as the odd part of that number
        odd = len(plan.words)
        while odd % 2 == 0:
            odd //= 2
        self._lag = LagWatch(period_s, max(WAIT_S, (odd - 0.5) * packet_s))
        self._left = b""

    @property
    def overflowed(self) -> bool:
        """Whether the instrument stopped because its buffer ran over."""
        return self._scans.overflowed

    def stop(self, left: bytes) -> None:
        """Note that it was stopped, and what had come by then."""
        self.stopped = True
        self._left = left

    def next_block(self, port: Port) -> ScanBlock | None:
        """Return the next scans; None when none has come."""
        now_s = time.monotonic()
        if self.complete:
            return self._block(np.zeros((0, len(self._plan.words)), dtype=np.int16), now_s)
        if self.stopped:
            left, self._left = self._left, b""
            return self._block(self._scans.take(left), now_s)
        chunks = port.receive(now_s + WAIT_S)
        if not chunks:
            return None
        self._hear()
        scans = self._scans.take(b"".join(data for data, _ in chunks))
        read_s = chunks[-1][1]
        if len(scans) and (missing := self._lag.missing(self._scans.delivered, read_s)):
            raise StreamFault(f"about {missing} scans are missing: they fall behind the clock")
        return self._block(scans, read_s) if len(scans) else None

    def _block(self, words: NDArray[np.int16], read_s: float) -> ScanBlock:
        words = words[: self._n_samples - self.delivered]
        values, saturated = self._plan.decode(words)
        if self._counter is not None and self._plan.counter is not None:
            column = self._plan.counter
            values[:, column] = self._counter(values[:, column], values[:, self._tacho])
        return self._delivered(values, saturated, (read_s, read_s))
