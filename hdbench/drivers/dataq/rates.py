"""From a sampling period to the device's three numbers, and to the size of its packets."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hdbench.drivers.dataq.models import Model
from hdbench.errors import DeviceError

__all__ = [
    "BUFFER_SAMPLES",
    "RateSetting",
    "choose_rate",
    "highest_rate_hz",
    "lowest_rate_hz",
    "packet_code",
]

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
    """What is written.

    Parameters
    ----------
    srate, dec, deca : int
        The three numbers.
    period_s : float
        The sampling period that they make, s.
    """

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
    for dec in decs:
        found = _with_dec(model, entries, total, dec)
        if found is not None and (best is None or _off(found, period_s) < _off(best, period_s)):
            best = found
        if best is not None and _off(best, period_s) < 1e-12 * period_s:
            break
    if average > model.dec_max or best is None or not _off(best, period_s) <= _TOLERANCE * period_s:
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


def _with_dec(model: Model, entries: int, total: float, dec: int) -> RateSetting | None:
    """Return the best numbers with a given dec; None where there are none."""
    shortest = model.shortest(entries)
    first = max(1, math.ceil(total / (dec * model.srate_max)))
    best: RateSetting | None = None
    for deca in range(first, min(first + _TRIES, model.deca_max + 1)):
        srate = round(total / (dec * deca))
        if not shortest <= srate <= model.srate_max:
            continue
        found = RateSetting(srate, dec, deca, srate * dec * deca / model.clock_hz(entries))
        wanted = total / model.clock_hz(entries)
        if best is None or _off(found, wanted) < _off(best, wanted):
            best = found
        if _off(best, wanted) < 1e-12 * wanted:
            break
    return best


def _off(setting: RateSetting, period_s: float) -> float:
    return abs(setting.period_s - period_s)
