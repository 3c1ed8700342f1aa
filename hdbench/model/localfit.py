"""Sampled signals: zero-phase derivatives by local polynomials, smoothing, delay."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

# a window of fewer samples than this has next to no averaging left for the degrees used here
MIN_HALF_WIDTH = 3
# time stamps this close to a uniform grid (relative to the period) move a derivative by as little
_UNIFORM = 1e-6
# a step longer than this many median periods is a gap: at most two samples are missing inside a fit
_GAP = 3.5
# windows solved in one call: bounds memory to some tens of megabytes
_BATCH = 20_000


@dataclass(frozen=True, slots=True)
class LocalFit:
    """A derivative and how well it is known."""

    derivative: FloatArray
    noise_std: float  # by the scatter of the values about the polynomials


def segments(time_s: FloatArray, period_s: float) -> list[slice]:
    """Return the stretches of `time_s` without a gap."""
    cuts = np.flatnonzero(np.diff(time_s) > _GAP * period_s) + 1
    edges = [0, *cuts.tolist(), len(time_s)]
    return [slice(a, b) for a, b in pairwise(edges) if b > a]


def fit_derivative(
    time_s: FloatArray, values: FloatArray, *, derivative: int, degree: int, window_s: float
) -> LocalFit:
    """Differentiate by a polynomial fitted to the samples around each sample.

    Notes
    -----
    Savitzky-Golay smoothing: least squares with equal weights. The window is centred, hence no
    phase; within half a window of an end of a stretch it stays inside and the polynomial is
    evaluated off its centre. Where samples lie on no uniform grid each window is solved for itself.

    References
    ----------
    A. Savitzky and M. J. E. Golay, Analytical Chemistry 36 (1964) 1627,
    doi:10.1021/ac60214a047.
    """
    result, residual = np.full((2, len(time_s)), np.nan)
    period, half = 0.0, 0
    for at, period in _stretches(time_s, values):
        half = _half_width(window_s, period)
        result[at], residual[at] = _segment(time_s[at], values[at], half, degree, derivative)
    if not half:
        return LocalFit(result, float("nan"))
    grid = period * np.arange(-half, half + 1, dtype=np.float64)
    value_row, slope_row = _rows(grid, degree, derivative)
    spare = np.sqrt(max(1.0 - float(value_row[half]), 0.0))
    known = residual[np.isfinite(residual)]
    scatter = float(np.sqrt(np.mean(known * known))) / spare if len(known) else float("nan")
    return LocalFit(result, scatter * float(np.linalg.norm(slope_row)))


def smoothed(time_s: FloatArray, values: FloatArray, *, degree: int, window_s: float) -> FloatArray:
    """Smooth by a polynomial fitted to the samples around each sample."""
    result = np.array(values, dtype=np.float64)
    for at, period in _stretches(time_s, values):
        half = _half_width(window_s, period)
        _, rest = _segment(time_s[at], values[at], half, degree, 1)
        result[at] -= np.where(np.isfinite(rest), rest, 0.0)
    return result


def _stretches(time_s: FloatArray, values: FloatArray) -> Iterator[tuple[NDArray[np.intp], float]]:
    """Yield the places of the samples of every stretch without a gap, and the median period."""
    present = np.flatnonzero(np.isfinite(values))
    if len(present) < 2:
        return
    time = time_s[present]
    period = float(np.median(np.diff(time)))
    for part in segments(time, period):
        yield present[part], period


def _half_width(window_s: float, period_s: float) -> int:
    return max(round(0.5 * window_s / period_s), MIN_HALF_WIDTH)


def _rows(offsets: FloatArray, degree: int, derivative: int) -> tuple[FloatArray, FloatArray]:
    """Return the weights that give value and derivative at offset 0."""
    scale = float(np.abs(offsets).max())
    inverse = np.linalg.pinv(np.vander(offsets / scale, degree + 1, increasing=True))
    return inverse[0], inverse[derivative] * (derivative / scale**derivative)


def _segment(
    time: FloatArray, values: FloatArray, half: int, degree: int, derivative: int
) -> tuple[FloatArray, FloatArray]:
    """Return derivative and residual of one stretch without a gap."""
    n = len(time)
    width = min(2 * half + 1, n)
    # one degree less than samples at most, else there is no residual and no averaging
    degree = min(degree, width - 2)
    if degree < derivative:
        return np.full(n, np.nan), np.full(n, np.nan)
    steps = np.diff(time)
    period = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - period) > _UNIFORM * period)
    slope, fitted = _uniform(values, period, width, degree, derivative)
    residual = values - fitted
    if len(uneven):
        first = np.clip(np.arange(n) - width // 2, 0, n - width)
        # uneven steps inside the window that begins at `first`
        count = np.searchsorted(uneven, first + width - 1) - np.searchsorted(uneven, first)
        at = np.flatnonzero(count)
        slope[at], residual[at] = _scattered(time, values, at, (width, degree, derivative))
    return slope, residual


def _uniform(
    values: FloatArray, period: float, width: int, degree: int, derivative: int
) -> tuple[FloatArray, FloatArray]:
    """Return derivative and fitted value on a uniform grid: one set of weights per place."""
    n, half = len(values), width // 2
    slope, fitted = np.empty(n), np.empty(n)
    windows = sliding_window_view(values, width)
    places = np.arange(width, dtype=np.float64)
    for place in range(width):
        value_row, slope_row = _rows(period * (places - place), degree, derivative)
        if place == half:
            inside = slice(half, half + len(windows))
            slope[inside], fitted[inside] = windows @ slope_row, windows @ value_row
        else:
            at = place if place < half else n - width + place
            window = windows[0] if place < half else windows[-1]
            slope[at], fitted[at] = window @ slope_row, window @ value_row
    return slope, fitted


def _scattered(
    time: FloatArray, values: FloatArray, chosen: NDArray[np.intp], rule: tuple[int, int, int]
) -> tuple[FloatArray, FloatArray]:
    """Return derivative and residual at samples `chosen`: one least-squares problem for each.

    `rule` is width, degree and derivative.
    """
    width, degree, derivative = rule
    slope, residual = np.empty(len(chosen)), np.empty(len(chosen))
    hankel = np.arange(degree + 1)[:, None] + np.arange(degree + 1)
    for begin in range(0, len(chosen), _BATCH):
        at = chosen[begin : begin + _BATCH]
        first = np.clip(at - width // 2, 0, len(time) - width)
        index = first[:, None] + np.arange(width)
        offset = time[index] - time[at, None]
        scale = np.abs(offset).max(axis=1)
        offset /= scale[:, None]
        rise = values[index] - values[at, None]
        moments, products = np.empty((len(at), 2 * degree + 1)), np.empty((len(at), degree + 1))
        power = np.ones_like(offset)
        for k in range(2 * degree + 1):
            moments[:, k] = power.sum(axis=1)
            if k <= degree:
                products[:, k] = (power * rise).sum(axis=1)
            power *= offset
        solution = np.linalg.solve(moments[:, hankel], products[:, :, None])[:, :, 0]
        part = slice(begin, begin + len(at))
        slope[part] = solution[:, derivative] * (derivative / scale**derivative)
        residual[part] = -solution[:, 0]
    return slope, residual


# a spline of degree 5 through all samples: 0.3 % off at a quarter of the sampling rate
_DEGREE: Final = 5


def delayed(time_s: FloatArray, values: FloatArray, delay_s: float) -> FloatArray:
    """Return a signal as it was a delay ago."""
    result = np.where(np.isfinite(values), values, np.nan)
    for at, _ in _stretches(time_s, values):
        result[at] = _shifted(time_s[at], values[at], delay_s)
    return result


def _shifted(time: FloatArray, samples: FloatArray, delay: float) -> FloatArray:
    """Return one stretch as it was `delay` ago; as it is where it is too short for a spline."""
    if len(time) <= _DEGREE + 1:
        return samples
    at = np.clip(time - delay, time[0], time[-1])
    period = float(time[-1] - time[0]) / (len(time) - 1)
    grid = time[0] + period * np.arange(len(time))
    if float(np.abs(time - grid).max()) > _UNIFORM * period:
        from scipy.interpolate import make_interp_spline

        return np.asarray(make_interp_spline(time, samples, k=_DEGREE)(at), dtype=np.float64)
    from scipy.ndimage import map_coordinates, spline_filter1d

    coefficients = spline_filter1d(samples, order=_DEGREE, mode="mirror")
    places = ((at - time[0]) / period)[None, :]
    out = map_coordinates(coefficients, places, order=_DEGREE, mode="mirror", prefilter=False)
    return np.asarray(out, dtype=np.float64)


def filled(time_s: FloatArray, values: FloatArray, lost: NDArray[np.bool_]) -> FloatArray:
    """Return a channel with some samples interpolated; NaN ahead of and behind all others.

    Notes
    -----
    A curve that does not overshoot at a bend.

    References
    ----------
    H. Akima, Journal of the ACM 17 (1970) 589, doi:10.1145/321607.321609.
    """
    from scipy.interpolate import Akima1DInterpolator

    known = np.isfinite(values) & ~lost
    if not lost.any() or int(known.sum()) < 2:
        return values
    curve = Akima1DInterpolator(time_s[known], values[known], method="makima")
    return np.where(lost, curve(time_s), values)
