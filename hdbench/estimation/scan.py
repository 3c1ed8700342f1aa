"""The strongest line of a whitened residual over motor order or frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hdbench.estimation.harmonics import Harmonic
from hdbench.records.trace import FloatArray

__all__ = ["NEIGHBOUR_RESOLUTIONS", "Domain", "Line", "strongest_line"]

# cycles in the record below which a line is not told from a drift
_LOWEST_CYCLES = 3.0
# bins per cycle of the highest order: nearest-bin rounding then loses under 1 % of the power
_BINS_PER_CYCLE = 16
# resolutions within which a neighbour is not told from a change of a component's amplitude
NEIGHBOUR_RESOLUTIONS = 2.0
_MAX_BINS = 1 << 21

Domain = Literal["motor-order", "frequency"]


@dataclass(frozen=True, slots=True)
class Line:
    """A sinusoid in a residual.

    Parameters
    ----------
    domain : {'motor-order', 'frequency'}
        What it is locked to.
    location : float
        Cycles per motor turn, or Hz.
    power : float
        Periodogram value of the whitened residual, exponential with mean 1 under noise.
    false_alarm_probability : float
        Chance that noise alone shows a line as strong anywhere in the range searched.
    component : Harmonic or None
        Amplitude and phase from the joint regression, once fitted.
    equivalent : float or None
        Location in the other domain, where the record cannot tell the two apart (their
        likelihoods are within 3 nats, as at constant velocity); else None.
    """

    domain: Domain
    location: float
    power: float
    false_alarm_probability: float
    component: Harmonic | None = None
    equivalent: float | None = None


def _false_alarm(power: float, width: float) -> float:
    """Baluev's bound for the maximum of a periodogram over `width` effective frequencies."""
    tail = math.exp(-power)
    return -math.expm1(math.log1p(-tail) - width * tail * math.sqrt(power))


def _periodogram(white: FloatArray, cycles: FloatArray, location: FloatArray) -> FloatArray:
    """Return the periodogram of unit white noise at given locations, by direct sums."""
    power = np.empty(len(location))
    for i, place in enumerate(location):
        angle = 2.0 * np.pi * place * cycles
        power[i] = (white @ np.cos(angle)) ** 2 + (white @ np.sin(angle)) ** 2
    return power / len(white)


def strongest_line(
    white: FloatArray,
    cycles: FloatArray,
    domain: Domain,
    *,
    taken: tuple[float, ...] = (),
) -> Line | None:
    """Return the strongest sinusoid of a whitened residual.

    Parameters
    ----------
    white : ndarray, shape (n,)
        Whitened residual, unit variance.
    cycles : ndarray, shape (n,)
        Motor turns for ``motor-order``, time in s for ``frequency``.
    domain : {'motor-order', 'frequency'}
        What `cycles` is.
    taken : tuple of float
        Locations already in the model; within two resolutions of them nothing is searched: a
        neighbour that beats less than twice with a component is a change of its amplitude.

    Returns
    -------
    Line or None
        None where the record spans too little.

    Notes
    -----
    The samples are gathered on an even grid of `cycles`, transformed, and the peak refined by
    direct sums. The false-alarm probability is Baluev's bound for the range searched.

    References
    ----------
    .. [1] R. V. Baluev, Mon. Not. R. Astron. Soc. 385 (2008) 1279,
       doi:10.1111/j.1365-2966.2008.12689.x.
    """
    span = float(np.ptp(cycles))
    step = np.abs(np.diff(cycles))
    step = step[step > 0.0]
    if len(step) < 16:
        return None
    # Nyquist by the faster samples of the record, so that little of what is searched folds
    high = min(0.49 / float(np.percentile(step, 90.0)), _MAX_BINS / _BINS_PER_CYCLE / span)
    low = _LOWEST_CYCLES / span
    if not high > 2.0 * low:
        return None
    n_bins = math.ceil(span * high * _BINS_PER_CYCLE) + 1
    where = np.rint((cycles - cycles.min()) * high * _BINS_PER_CYCLE).astype(np.int64)
    grid = np.bincount(where, weights=white, minlength=n_bins)
    size = 1 << (2 * n_bins - 1).bit_length()
    power = np.abs(np.fft.rfft(grid, size)) ** 2 / len(white)
    location = np.arange(len(power)) * (high * _BINS_PER_CYCLE / size)
    searched = (location >= low) & (location <= high)
    for place in taken:
        searched &= np.abs(location - place) > NEIGHBOUR_RESOLUTIONS / span
    if not searched.any():
        return None
    best = float(location[int(np.argmax(np.where(searched, power, -1.0)))])
    for width in (0.5 / span, 0.05 / span):
        fine = best + np.linspace(-width, width, 21)
        sums = _periodogram(white, cycles, fine)
        best, top = float(fine[int(np.argmax(sums))]), float(np.max(sums))
    effective = (high - low) * math.sqrt(4.0 * math.pi * float(np.var(cycles)))
    return Line(domain, best, top, _false_alarm(top, effective))
