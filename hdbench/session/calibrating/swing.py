"""A weight that swings: its period in the readings, and averages over whole periods."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.records import FloatArray

__all__ = ["PERIODS", "Swing", "find_swing", "whole_period_mean"]

# Whole periods averaged. The vertical force of a pendulum varies at twice its frequency, the
# horizontal one on a low hanging point at the frequency itself: an even number of either holds
# whole periods of both.
PERIODS = 6

# Hangers of 0.02 m to 3 m swing at 0.29 Hz to 3.5 Hz; twice that at most.
_LOWEST_HZ, _HIGHEST_HZ = 0.25, 7.0

# Needed to tell a period from a drift.
_LEAST_PERIODS = 2.5

# Chance that white noise alone shows a swing in one look: a reading takes a few dozen looks.
_FALSE_ALARM = 1e-4

_PADDING = 8  # the spectrum's grid is this much finer than one cycle per record


@dataclass(frozen=True, slots=True)
class Swing:
    """An oscillation of the reading.

    Parameters
    ----------
    period_s : float
        Period of its strongest component, s.
    amplitude_v : float
        Amplitude in the middle of the samples, V.
    """

    period_s: float
    amplitude_v: float


def find_swing(samples_v: FloatArray, period_s: float) -> tuple[Swing, FloatArray] | None:
    r"""Find an oscillation in readings under one weight.

    Notes
    -----
    The frequency is the highest point of the Hann spectrum of the readings less their straight
    line, refined by a parabola; then :math:`a + b t + (c + d t) \cos \omega t + (e + f t) \sin
    \omega t` is fitted, so that a decay is followed. White noise of n samples exceeds the accepted
    share of the sum of squares with probability 1e-4 [1]_: share of one component 1 - q,
    :math:`(1 - q)^{(n-1)/2} = 10^{-4} / m` over m frequencies.

    References
    ----------
    .. [1] R. A. Fisher, "Tests of significance in harmonic analysis", Proc. R. Soc. A 125, 1929.
    """
    n = len(samples_v)
    length_s = n * period_s
    if n < 16 or length_s * _HIGHEST_HZ < _LEAST_PERIODS:
        return None
    time = (np.arange(n) - 0.5 * (n - 1)) * period_s
    flat = samples_v - np.polynomial.polynomial.polyval(
        time, np.polynomial.polynomial.polyfit(time, samples_v, 1)
    )
    frequency_hz = _peak_hz(flat, period_s)
    if frequency_hz is None or not frequency_hz * length_s >= _LEAST_PERIODS:
        return None
    wave = np.exp(2j * math.pi * frequency_hz * time)
    scaled = time / length_s
    columns = [np.ones(n), scaled, wave.real, wave.imag, scaled * wave.real, scaled * wave.imag]
    design = np.column_stack(columns)
    fitted = np.linalg.lstsq(design, samples_v, rcond=None)[0]
    oscillation = design[:, 2:] @ fitted[2:]
    rest = samples_v - oscillation
    left = float(np.sum((rest - design[:, :2] @ fitted[:2]) ** 2))
    frequencies = max(1.0, length_s * (_HIGHEST_HZ - _LOWEST_HZ))
    allowed = (_FALSE_ALARM / frequencies) ** (2.0 / (n - 1))
    if not left <= allowed * float(np.sum(flat**2)):
        return None
    return Swing(1.0 / frequency_hz, float(np.hypot(fitted[2], fitted[3]))), rest


def _peak_hz(flat_v: FloatArray, period_s: float) -> float | None:
    """Return the frequency of the highest point of the spectrum, Hz."""
    n_fft = _PADDING * len(flat_v)
    power = np.abs(np.fft.rfft(flat_v * np.hanning(len(flat_v)), n_fft)) ** 2
    grid_hz = 1.0 / (n_fft * period_s)
    low = max(1, math.ceil(_LOWEST_HZ / grid_hz))
    high = min(len(power) - 1, math.floor(_HIGHEST_HZ / grid_hz))
    if high <= low:
        return None
    top = low + int(np.argmax(power[low:high]))
    left, middle, right = np.sqrt(power[top - 1 : top + 2])
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float((top + shift) * grid_hz)


def whole_period_mean(samples_v: FloatArray, n_samples: float) -> float:
    """Return the mean over exactly `n_samples` sampling periods up to the last sample."""
    whole = math.floor(n_samples)
    part = n_samples - whole
    last = samples_v[-(whole + 1) :]
    total = float(np.sum(last)) - 0.5 * float(last[0] + last[-1])
    if part > 0.0:
        first, before = float(last[0]), float(samples_v[-(whole + 2)])
        total += part * (first + 0.5 * part * (before - first))
    return total / n_samples
