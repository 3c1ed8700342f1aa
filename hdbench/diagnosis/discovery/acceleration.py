"""Acceleration of a record as far as the measured motion stands out of its channel's noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdbench.diagnosis.discovery.bands import mirrored_lines, smoothed
from hdbench.model import Motion
from hdbench.model.localfit import MIN_HALF_WIDTH
from hdbench.model.motion import ACCELERATION_WINDOW_S
from hdbench.records.trace import FloatArray

# cells of a short-time spectrum: so long, of so many samples at least, and motion where the mean of
# nine has so many times the power of the noise
_CELL_S, _LEAST_CELL, _STANDS_OUT = 0.2, 32, 5.0
# lines that turn with the motor are sought over so long, up to this order, from so many turns on; a
# line has no neighbours to average: 4.5e-5 is the chance of so many times the noise's power
_LOCKED_S, _LOCKED_ORDERS, _LOCKED_TURNS, _ONE_STANDS_OUT = 2.0, 12, 4.0, 10.0


def accelerations(motion: Motion, period_s: float) -> tuple[Motion, ...]:
    """Return the motion with its acceleration as far as that stands out of its channel's noise.

    First all of it, then what is slower than the window over which the acceleration of a trace is
    formed: what is faster may be no motion of the load. The motion itself where it is too short, or
    has pauses as long as it is.
    """
    from scipy.interpolate import Akima1DInterpolator

    degree = 2 if motion.acceleration_source == "angle" else 1
    values, time = motion.angle_rad if degree == 2 else motion.velocity_rad_s, motion.time_s
    known = np.isfinite(values)
    count = round((time[-1] - time[0]) / period_s) + 1
    if known.sum() < 2 * _LEAST_CELL or count > 2 * len(time):
        return (motion,)
    ticks = time[0] + period_s * np.arange(count)
    at_ticks = Akima1DInterpolator(time[known], values[known], method="makima", extrapolate=True)
    made = _derivative(at_ticks(ticks), period_s, degree)
    kept, noise = _standing_out(made, period_s, degree, _step_of(values[known]))
    angle = np.interp(ticks, time[known], motion.angle_rad[known])
    kept += _locked(made - kept, angle, period_s, degree, noise)
    window_s = max(ACCELERATION_WINDOW_S, (2 * MIN_HALF_WIDTH + 1) * period_s)
    slow = smoothed(kept[:, None], 2.0 * period_s / window_s)[:, 0]
    return tuple(
        replace(motion, acceleration_rad_s2=np.interp(time, ticks, one)) for one in (kept, slow)
    )


def _locked(
    rest: FloatArray, angle_rad: FloatArray, period_s: float, degree: int, noise: float
) -> FloatArray:
    """Return the lines of a derivative at whole orders of the motor that stand out of the noise.

    Over a longer time than a cell they are told from lines that do not turn with the shaft.
    """
    from scipy.ndimage import uniform_filter1d
    from scipy.signal import oaconvolve

    width = min(round(_LOCKED_S / period_s), len(rest))
    window = np.hanning(width + 2)[1:-1]
    window /= window.sum()
    turning = uniform_filter1d(np.gradient(angle_rad, period_s), width) / (2.0 * np.pi)
    out = np.zeros(len(rest))
    once, turned = np.exp(1j * angle_rad), np.ones(len(rest), dtype=complex)
    for order in range(1, _LOCKED_ORDERS + 1):
        turned *= once
        amount = 2.0 * oaconvolve(rest * turned.conj(), window, mode="same")
        hertz = order * np.abs(turning)
        level = 4.0 * float(window @ window) * noise * hertz ** (2 * degree)
        stands = (np.abs(amount) ** 2 > _ONE_STANDS_OUT * level) & (hertz < 0.5 / period_s)
        stands &= np.abs(turning) * _LOCKED_S > _LOCKED_TURNS
        out += np.where(stands, np.real(amount * turned), 0.0)
    return out


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
    fast: FloatArray, period_s: float, degree: int, step: float
) -> tuple[FloatArray, float]:
    """Return what of a derivative of the measured motion stands out of its channel's noise.

    And that noise: variance of a sample over the frequency to twice the degree.

    A cell of the short-time spectrum takes part where it stands out of the noise, which is even
    over the frequencies of what was differentiated: a line that the speed moves is kept, the noise
    beside it is not. Counting steps make lines, as steady as the speed: the first of their sawtooth
    has an amplitude of the step over pi, and no line below that takes part.
    """
    from scipy.ndimage import uniform_filter
    from scipy.signal import ShortTimeFFT

    width = min(max(_LEAST_CELL, round(_CELL_S / period_s)), len(fast) // 2)
    cells = ShortTimeFFT.from_window("hann", 1.0 / period_s, width, 3 * width // 4)
    seen = cells.stft(fast)
    power = np.abs(seen) ** 2 / np.maximum(cells.f, cells.f[1])[:, None] ** (2 * degree)
    # the median of the upper octave: lines stand in few cells; that of an exponential is ln 2
    noise = float(np.median(power[cells.f > 0.5 * cells.f[-1]])) / np.log(2.0)
    # a line stands in three cells of a Hann window, a half of its power in their mean; between two
    # cells, or with the next harmonic beside it, it may have twice that
    counted = 2.0 * 0.5 * (0.5 * step / np.pi * cells.win.sum() * (2.0 * np.pi) ** degree) ** 2
    kept = uniform_filter(power, 3) > max(_STANDS_OUT * noise, counted)
    made = np.real(cells.istft(np.where(kept, seen, 0.0), k1=len(fast)))
    of_steps = step**2 / 12.0 * (2.0 * np.pi) ** (2 * degree)
    return made, max(noise / float(cells.win @ cells.win), of_steps)


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
