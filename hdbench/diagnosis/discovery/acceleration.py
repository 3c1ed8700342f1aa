"""Acceleration of a record as far as the measured motion stands out of its channel's noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdbench.diagnosis.discovery.bands import mirrored_lines
from hdbench.model import Motion
from hdbench.records.trace import FloatArray

# cells of a short-time spectrum: so long, of so many samples at least, and motion where the mean of
# nine has so many times the power of the noise
_CELL_S, _LEAST_CELL, _STANDS_OUT = 0.2, 32, 5.0
# the square of a sum of products without a common part is above so many times that of their squares
# once in a hundred, where three quarters of a cell are in the next
_AGREE = 9.0
# a drive answers alike to frequencies within so many octaves
_ALIKE = 0.25


def seen_acceleration(
    motion: Motion, ripple_nm: FloatArray, period_s: float
) -> tuple[Motion, FloatArray]:
    """Return the motion with its acceleration as far as that stands out of its channel's noise.

    And how the speed answers to the ripple in the rest, rad/s^2. The motion itself where it is too
    short, or has pauses as long as it is.
    """
    from scipy.interpolate import Akima1DInterpolator

    degree = 2 if motion.acceleration_source == "angle" else 1
    values, time = motion.angle_rad if degree == 2 else motion.velocity_rad_s, motion.time_s
    known = np.isfinite(values)
    count = round((time[-1] - time[0]) / period_s) + 1
    if known.sum() < 2 * _LEAST_CELL or count > 2 * len(time):
        return motion, np.zeros(len(time))
    ticks = time[0] + period_s * np.arange(count)
    at_ticks = Akima1DInterpolator(time[known], values[known], method="makima", extrapolate=True)
    made = _derivative(at_ticks(ticks), period_s, degree)
    ripple = np.interp(ticks, time, ripple_nm)
    seen, answer = (
        np.interp(time, ticks, one)
        for one in _standing_out(made, ripple, period_s, degree, _step_of(values[known]))
    )
    return replace(motion, acceleration_rad_s2=seen), answer


def _step_of(values: FloatArray) -> float:
    """Return the step in which values were counted; 0 where they were not."""
    turns = np.abs(np.diff(values, 2))
    # rounding is far below a step, and few samples are interpolated
    turns = turns[turns > 1e-12 * np.abs(values).max()]
    if not len(turns):
        return 0.0
    step = float(np.quantile(turns, 0.1))
    beside = np.abs(turns - step * np.round(turns / step))
    # a fifth is within a tenth of a whole number by chance
    return step if float(np.mean(beside < 0.1 * step)) > 0.5 else 0.0


def _standing_out(
    fast: FloatArray, ripple_nm: FloatArray, period_s: float, degree: int, step: float
) -> tuple[FloatArray, FloatArray]:
    """Return what of a derivative of the measured motion stands out of its channel's noise.

    And how it answers to the ripple of the torque in the rest. A cell of the short-time spectrum
    takes part where it stands out of the noise, which is even over the frequencies of what was
    differentiated: a line that the speed moves is kept, the noise beside it is not. Counting steps
    make lines, as steady as the speed: the first of their sawtooth has an amplitude of the step
    over pi, and no line below that takes part. The speed of a drive answers to its torque: where
    the other cells agree on that, it says the rest.
    """
    from scipy.ndimage import uniform_filter
    from scipy.signal import ShortTimeFFT

    width = min(max(_LEAST_CELL, round(_CELL_S / period_s)), len(fast) // 2)
    cells = ShortTimeFFT.from_window("hann", 1.0 / period_s, width, 3 * width // 4)
    # cells at the ends are cut: they lie outside
    fast, ripple_nm = (np.pad(one, width, mode="edge") for one in (fast, ripple_nm))
    seen = cells.stft(fast)
    level = np.maximum(cells.f, cells.f[1])[:, None] ** (2 * degree)
    # the median of the upper octave: lines stand in few cells; that of an exponential is ln 2
    noise = float(np.median((np.abs(seen) ** 2 / level)[cells.f > 0.5 * cells.f[-1]])) / np.log(2.0)
    # a line stands in three cells of a Hann window, a half of its power in their mean; between two
    # cells, or with the next harmonic beside it, it may have twice that
    counted = 2.0 * 0.5 * (0.5 * step / np.pi * cells.win.sum() * (2.0 * np.pi) ** degree) ** 2
    least = max(_STANDS_OUT * noise, counted)
    kept = np.where(uniform_filter(np.abs(seen) ** 2 / level, 3) > least, seen, 0.0)
    asked = np.where(kept == 0.0, cells.stft(ripple_nm), 0.0)
    # the noise grows with the frequency
    both = seen * asked.conj() / level
    octave = np.log2(np.maximum(cells.f, cells.f[1]))
    beside = np.abs(octave - octave[:, None]) < _ALIKE
    agreed, asks = (beside @ one.sum(axis=1) for one in (both, np.abs(asked) ** 2 / level))
    answers = np.abs(agreed) ** 2 > _AGREE * (beside @ (np.abs(both) ** 2).sum(axis=1))
    answer = asked * (np.where(answers, agreed, 0.0) / np.maximum(asks, 1e-300))[:, None]
    alone, told = (
        np.real(cells.istft(lines, k1=len(fast)))[width:-width] for lines in (kept, answer)
    )
    return alone, told


def _derivative(values: FloatArray, period_s: float, degree: int) -> FloatArray:
    """Return the derivative of a measured motion by its spectrum."""
    from scipy.interpolate import CubicHermiteSpline

    n = len(values)
    # less a cubic with the same values and slopes at both ends, so that the mirrored ends meet
    slopes = [np.diff(values[:9]).mean(), np.diff(values[-9:]).mean()]
    ends = CubicHermiteSpline([0.0, n - 1.0], values[[0, -1]], slopes)
    lines = mirrored_lines(values - ends(np.arange(n)))
    whole = len(lines) - 1
    turn = 2j * np.pi * np.arange(len(lines)) / (2.0 * whole * period_s)
    made = np.fft.irfft(lines * turn**degree, 2 * whole)[:n]
    return np.asarray(made + ends(np.arange(n), degree) / period_s**degree)
