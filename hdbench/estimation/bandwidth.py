"""Bandwidth of a channel: up to where it holds more than rounding, and the scatter of a sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from hdbench.records.trace import FloatArray

# side lobes 220 dB down: a strong slow part must not hide an empty floor behind them
_WINDOW = ("kaiser", 30)
# bins of half the main lobe of that window: what is no wider is one slow line
_LOBE = 10
# samples of the longest segment of an average
_LONGEST = 2048


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Power of a channel over frequency."""

    frequency_hz: FloatArray
    density: FloatArray  # unit^2/Hz, without single lines
    limit_hz: float | None  # above it there is nothing but rounding; None where noise goes on
    computed: bool  # whether there is no noise below it either
    noise: float  # root of the power of a floor as high as the end of the band


def spectrum_of(values: FloatArray, rate_hz: float, step: float) -> Spectrum | None:
    """Return the spectrum of a channel.

    Notes
    -----
    A sensor has noise up to the end of the band. Where the floor is that of the channel's own
    rounding, ``step^2 / 12`` over the band, or 20 bits below its range, what made the noise was
    taken away above the limit. Of rounding alone only where it is fine, and where the channel falls
    to it as steeply as no two poles make it. Filtered noise is about as strong in every stretch of
    a record, lines of a swinging shaft are not: the geometric mean over stretches is .09 of the
    mean or more on filtered logs, and 2e-4 or less where nothing is noise.
    """
    from scipy.signal import spectrogram, welch  # half a second of every start

    known = np.isfinite(values)
    if int(known.sum()) < 256 or not float(np.ptp(values[known])) > 0.0:
        return None
    # eight segments at least: a median of so many bins is known to a tenth
    size = max(64, min(_LONGEST, len(values) // 8))
    at = np.arange(len(values))
    whole = np.interp(at, at[known], values[known])
    frequency, power = welch(whole, rate_hz, _WINDOW, nperseg=size)
    width = max(3, len(power) // 32) | 1
    # the median of a few bins is the noise between the lines
    density = median_filter(power, size=width, mode="nearest")[1:]
    frequency = frequency[1:]
    band = 0.5 * rate_hz
    floor = float(np.median(power[1:][frequency > 0.9 * band]))
    span = float(np.ptp(values[known]))
    rounding = (2.0**-20 * span) ** 2 / 12.0 / band
    # steps finer than 15 bits of the range hide no noise of a sensor
    if step < 2.0**-15 * span:
        rounding = max(rounding, step**2 / 12.0 / band)
    limit, computed = None, False
    # noise of 0.3 steps makes a floor of 2.1 times that of rounding alone
    if floor < 1.6 * rounding:
        # the channel ends where it stands out of the floor by less than ten; four poles fall by 256
        # within the octave below, two by 16. Near the end of the band it limits nothing
        above = int(np.flatnonzero(density > 10.0 * rounding).max(initial=0))
        if density[above // 2] > 64.0 * 10.0 * rounding and frequency[above] <= 0.8 * band:
            limit = float(frequency[above])
            parts = spectrogram(whole, rate_hz, _WINDOW, size, size // 2)[2]
            inside = np.maximum(parts[1:][above // 4 : above // 2 + 1], rounding)
            even = np.exp(np.log(inside).mean(axis=1)) / inside.mean(axis=1)
            computed = above <= _LOBE or bool(np.median(even) < 4e-3)
    return Spectrum(frequency, density, limit, computed, float(np.sqrt(floor * band)))
