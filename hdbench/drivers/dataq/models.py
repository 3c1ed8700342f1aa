"""DATAQ models: channels, ranges, clocks, and the rates that they have."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from hdbench.errors import DeviceError

_RANGES_4108 = {10.0: 0, 5.0: 1, 2.0: 2, 1.0: 3, 0.5: 4, 0.2: 5}
_RANGES_4208 = {100.0: 0, 50.0: 1, 20.0: 2, 10.0: 3, 5.0: 4, 2.0: 5}
# codes 0 to 5 have bit 11 clear, 8 to 13 have it set
_RANGES_2008 = {
    0.5: 0, 0.25: 1, 0.1: 2, 0.05: 3, 0.025: 4, 0.01: 5,
    50.0: 8, 25.0: 9, 10.0: 10, 5.0: 11, 2.5: 12, 1.0: 13,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Model:
    """One model."""

    number: str
    ranges: Mapping[float, int] = field(default_factory=lambda: {10.0: 0})
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


# DATAQ, "Data Acquisition Instrument Command Protocol", 1 Aug 2019, pages 48 and 60 to 70; ranges
# of the DI-2008 as in its maker's example program
MODELS: Mapping[str, Model] = {
    "DI-1100": Model(
        "1100", srate_min=1500, srate_step=500, dec_max=1, deca_max=1, bits=12, digital=False
    ),
    "DI-1110": Model("1110", dec_max=1, bits=12),
    "DI-1120": Model("1120", _RANGES_4208, bits=14),
    "DI-2008": Model(
        "2008", _RANGES_2008, 800.0, 4, 2232, 32767, 1, throughput=True, single_dividend=8000.0
    ),
    "DI-2108": Model("2108"),
    "DI-2108P": Model(
        "2108P", {10.0: 0, 5.0: 1, 2.5: 2}, 120e6, 750, 65535, 512, 1, throughput=True
    ),
    "DI-4108": Model("4108", _RANGES_4108),
    "DI-4208": Model("4208", _RANGES_4208),
    "DI-4718B": Model("4718B", {5.0: 0}),
}


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
    code = math.floor(math.log2(n_bytes / 16.0)) if n_bytes >= 16.0 else 0
    return min(code, _LARGEST_CODE)


def _settings(model: Model, entries: int, total: float, decs: list[int]) -> Iterator[RateSetting]:
    """Yield numbers whose product is near `total`."""
    for dec in decs:
        first = max(1, math.ceil(total / (dec * model.srate_max)))
        for deca in range(first, min(first + _TRIES, model.deca_max + 1)):
            srate = round(total / (dec * deca))
            if model.shortest(entries) <= srate <= model.srate_max:
                period_s = srate * dec * deca / model.clock_hz(entries)
                yield RateSetting(srate, dec, deca, period_s)
