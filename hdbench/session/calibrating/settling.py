"""Settling of a reading under a weight; one that swings is averaged over whole periods."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyfit, polyval

from hdbench.profile.calibrating import CalibrationPlan
from hdbench.records import FloatArray


@dataclass(frozen=True, slots=True)
class SettleRule:
    """What settled means."""

    period_s: float
    window: int
    band_v: float
    read_after: int
    limit: int


def settle_rule(plan: CalibrationPlan, read_after_s: float, gain_nm_per_v: float) -> SettleRule:
    """Return the rule of a profile."""
    window = max(2, round(plan.average_s / plan.sample_period_s))
    read_after = math.ceil(read_after_s / plan.sample_period_s)
    limit = read_after + max(2 * window, round(plan.settle_timeout_s / plan.sample_period_s))
    band_v = plan.settle_band_nm / gain_nm_per_v
    return SettleRule(plan.sample_period_s, window, band_v, read_after, limit)


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
    """An oscillation of the reading."""

    period_s: float
    amplitude_v: float


def find_swing(samples_v: FloatArray, period_s: float) -> tuple[Swing, FloatArray] | None:
    r"""Find an oscillation in readings under one weight.

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
    flat = samples_v - polyval(time, polyfit(time, samples_v, 1))
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


# Parts in which the bar grows.
_PARTS = 8

# Longest record searched for a swing: two averages of the slowest pendulum looked for.
_SEARCH_S = 2.0 * PERIODS / 0.5


@dataclass(frozen=True, slots=True)
class SettledReading:
    """The average of a settled window."""

    mean_v: float
    std_v: float
    n_samples: int
    settled: bool
    slope_v_s: float = 0.0
    lag1: float = 0.0
    swing: Swing | None = None


@dataclass(frozen=True, slots=True)
class Judgement:
    """The reading at one moment."""

    value_v: float
    slope_v_s: float
    spread_v: float
    share: float
    swing: Swing | None
    reading: SettledReading | None


def judge(samples_v: FloatArray, rule: SettleRule) -> Judgement:
    """Judge readings since the weight was hung.

    Settled when the means of two adjacent windows differ by less than the band plus three standard
    errors of that difference, and the spread of either is no more than 1.5 times what its
    sample-to-sample differences explain (a weight that bounces or swings is correlated, noise is
    not): std <= 1.5 * std(diff)/sqrt(2), or below the band. A swing beyond that is taken out
    first, and the windows are then `PERIODS` of its periods long, or more where one window of the
    rule is longer: over whole periods the vertical force of a pendulum averages to its weight.
    """
    last = samples_v[-rule.window :]
    value_v, slope_v_s, spread_v = float(np.mean(last)), _slope(last, rule), float(np.ptp(last))
    share: float = 0.0
    swing: Swing | None = None
    reading: SettledReading | None = None
    if len(samples_v) > rule.read_after:
        share, reading = _calm(samples_v, rule)
        if reading is None or _moved_by_swing(samples_v, rule):
            share, swing, reading = _swinging(samples_v, rule) or (share, None, reading)
    if reading is not None:
        value_v, slope_v_s = reading.mean_v, reading.slope_v_s
    return Judgement(value_v, slope_v_s, spread_v, share, swing, reading)


def average_now(samples_v: FloatArray, rule: SettleRule) -> SettledReading:
    """Average the last window as it is, marked as not settled."""
    found = find_swing(_tail(samples_v, rule), rule.period_s)
    if found is not None:
        swing, rest_v = found
        length = PERIODS * swing.period_s / rule.period_s
        if length <= len(samples_v) - 2:
            mean_v = whole_period_mean(samples_v, length)
            return _reading(rest_v[-math.ceil(length) :], rule, mean_v, swing, settled=False)
    last = samples_v[-rule.window :]
    return _reading(last, rule, float(np.mean(last)), None, settled=False)


def _calm(samples_v: FloatArray, rule: SettleRule) -> tuple[float, SettledReading | None]:
    """Judge readings without swing."""
    usable = len(samples_v) - rule.read_after
    share = 0.0
    for part in range(_PARTS, 0, -1):
        window = max(2, rule.window * part // _PARTS)
        if window <= usable and _steady(samples_v[-2 * window :], window, rule.band_v):
            share = part / _PARTS
            break
    if share < 1.0:
        return share, None
    last = samples_v[-rule.window :]
    return 1.0, _reading(last, rule, float(np.mean(last)), None, settled=True)


def _moved_by_swing(samples_v: FloatArray, rule: SettleRule) -> bool:
    """Return whether a swing within the noise would still move an average over one window.

    A part of a period left over moves it by up to amplitude * period / (pi * window): harmless
    below a third of the band, beside which the other two thirds are drift and noise.
    """
    found = find_swing(samples_v[-2 * rule.window :], rule.period_s)
    if found is None:
        return False
    window_s = rule.window * rule.period_s
    moved_v = found[0].amplitude_v * found[0].period_s / (math.pi * window_s)
    return not moved_v <= rule.band_v / 3.0


def _steady(samples_v: FloatArray, window: int, band_v: float) -> bool:
    if len(samples_v) < 2 * window:
        return False
    before, last = samples_v[:window], samples_v[window:]
    error = math.sqrt((float(np.var(before, ddof=1)) + float(np.var(last, ddof=1))) / window)
    still = abs(float(np.mean(last) - np.mean(before))) <= band_v + 3.0 * error
    return still and _is_noise(before, band_v) and _is_noise(last, band_v)


def _is_noise(samples_v: FloatArray, band_v: float) -> bool:
    """Return whether the spread is what neighbouring samples explain, or within the band."""
    std = float(np.std(samples_v, ddof=1))
    if std <= band_v or len(samples_v) < 3:
        return std <= band_v
    return std <= 1.5 * float(np.std(np.diff(samples_v), ddof=1)) / math.sqrt(2.0)


def _tail(samples_v: FloatArray, rule: SettleRule) -> FloatArray:
    return samples_v[-max(2 * rule.window, round(_SEARCH_S / rule.period_s)) :]


def _swinging(
    samples_v: FloatArray, rule: SettleRule
) -> tuple[float, Swing | None, SettledReading | None] | None:
    """Judge readings with a swing; None where there is none."""
    found = find_swing(_tail(samples_v, rule), rule.period_s)
    if found is None:
        return None
    # the part searched still holds the bounce of the first moments: look again without it
    per_period = found[0].period_s / rule.period_s
    periods = max(PERIODS, 2 * math.ceil(0.5 * rule.window / per_period))
    length = periods * per_period
    needed = 2 * math.ceil(length) + 2
    share = min(1.0, (len(samples_v) - rule.read_after) / needed, len(samples_v) / needed)
    if needed > len(samples_v) or math.ceil(length) > len(samples_v) - rule.read_after:
        return max(0.0, min(share, 0.99)), found[0], None
    recent = samples_v[-needed:]
    again = find_swing(recent, rule.period_s)
    if again is None:
        return None
    swing, rest_v = again
    window = math.ceil(length)
    if not _steady(rest_v[-2 * window :], window, rule.band_v):
        return 0.5, swing, None
    length = min(periods * swing.period_s / rule.period_s, len(recent) - 2.0)
    mean_v = whole_period_mean(recent, length)
    return 1.0, swing, _reading(rest_v[-window:], rule, mean_v, swing, settled=True)


def _slope(samples_v: FloatArray, rule: SettleRule) -> float:
    """Return the slope of the straight line through samples, V/s."""
    time = (np.arange(len(samples_v)) - 0.5 * (len(samples_v) - 1)) * rule.period_s
    return float(time @ samples_v / (time @ time))


def _reading(
    samples_v: FloatArray, rule: SettleRule, mean_v: float, swing: Swing | None, *, settled: bool
) -> SettledReading:
    slope_v_s = _slope(samples_v, rule)
    centred = samples_v - np.mean(samples_v)
    total = float(centred @ centred)
    lag1 = float(centred[1:] @ centred[:-1]) / total if total > 0.0 else 0.0
    std_v = math.sqrt(total / (len(samples_v) - 1))
    return SettledReading(mean_v, std_v, len(samples_v), settled, slope_v_s, lag1, swing)
