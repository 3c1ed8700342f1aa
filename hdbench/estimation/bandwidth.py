"""Spectrum of a channel: up to where it holds more than rounding, and the scatter of a sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import welch

from hdbench.records.trace import FloatArray

__all__ = ["Spectrum", "spectrum_of"]

# segments of the average at least, and samples of one: a median of so many bins is known to a tenth
_SEGMENTS, _LONGEST, _SHORTEST = 8, 2048, 64
# side lobes 220 dB down: a strong slow part must not hide an empty floor behind them
_WINDOW = ("kaiser", 30)
# the floor is that of the last tenth of the band
_TOP = 0.9
# a floor this many times that of rounding is rounding alone: noise of 0.3 steps makes it 2.1
_ROUNDING = 1.6
# bits of a sensor: none of torque or current has noise below this part of its own range
_BITS = 20
# steps finer than this part of the range hide no noise of a sensor
_FINE = 15
# fall within the octave below the limit that a filter makes: four poles make 256, two make 16
_OCTAVE = 64.0
# the channel ends where it stands out of the floor by less than this
_ABOVE = 10.0
# a floor that begins nearer to the end of the band than this limits nothing
_OPEN = 0.8


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Power of a channel over frequency.

    Parameters
    ----------
    frequency_hz, density : ndarray
        Hz, and unit^2/Hz, without single lines.
    limit_hz : float or None
        Frequency above which it holds nothing but rounding; None where noise goes on to the end.
    noise : float
        Root of the power of a floor as high as the end of the band.
    """

    frequency_hz: FloatArray
    density: FloatArray
    limit_hz: float | None
    noise: float


def spectrum_of(values: FloatArray, rate_hz: float, step: float) -> Spectrum | None:
    """Return the spectrum of a channel.

    Notes
    -----
    A sensor has noise up to the end of the band. Where the floor is that of the channel's own
    rounding, ``step^2 / 12`` over the band, or 20 bits below its range, what made the noise was
    taken away above the limit. Of rounding alone only where it is fine, and where the channel falls
    to it as steeply as no two poles make it.
    """
    known = np.isfinite(values)
    if int(known.sum()) < _SEGMENTS * _SHORTEST // 2 or not float(np.ptp(values[known])) > 0.0:
        return None
    at = np.arange(len(values))
    whole = values if known.all() else np.interp(at, at[known], values[known])
    size = max(_SHORTEST, min(_LONGEST, len(values) // _SEGMENTS))
    frequency, power = welch(whole, rate_hz, _WINDOW, nperseg=size)
    width = max(3, len(power) // 32) | 1
    # the median of a few bins is the noise between the lines
    density = median_filter(power, size=width, mode="nearest")[1:]
    frequency = frequency[1:]
    place = frequency / (0.5 * rate_hz)
    band = 0.5 * rate_hz
    floor = float(np.median(power[1:][place > _TOP]))
    span = float(np.ptp(values[known]))
    rounding = (2.0**-_BITS * span) ** 2 / 12.0 / band
    if step < 2.0**-_FINE * span:
        rounding = max(rounding, step**2 / 12.0 / band)
    limit: float | None = None
    if floor < _ROUNDING * rounding:
        above = int(np.flatnonzero(density > _ABOVE * rounding).max(initial=0))
        if density[above // 2] > _OCTAVE * _ABOVE * rounding:
            limit = float(frequency[above])
    if limit is not None and limit > _OPEN * band:
        limit = None
    return Spectrum(frequency, density, limit, float(np.sqrt(floor * band)))
