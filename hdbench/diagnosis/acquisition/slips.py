"""Jumps between encoder and tacho: slips of the encoder, and samples that the stamps hide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.acquisition.channels import Shaft, robust_std
from hdbench.diagnosis.acquisition.integration import unintegrated_rad
from hdbench.records.trace import FloatArray

__all__ = ["Jump", "encoder_glitches", "find_jumps", "velocity_spikes"]

# seven standard deviations happen once in 4e11 normal samples
_SIGMA = 7.0
# a counted angle is off by less than one count, whatever beats with the sampling; 0.8 of one more
# is seven standard deviations of the tacho's share, and what bends within a sampling period
_COUNTS = 1.8
# where the acceleration jumps by 2500 rad/s^2 the trapezoidal rule is off by 0.3 mrad at 1 kHz;
# half a milliradian turns ripple of order 2 by a thousandth of its amplitude
_SMALLEST_RAD = 5e-4
# steps of the tacho's converter: three neighbours rounded alike are off by one and a half together,
# half of a jump, and noise comes on top
_ROUNDING = 4.0
# times the lateness of one stamp in a hundred that a stamp may be late
_LATE = 3.0
# samples on each side: there the averaged counting of a 4000-count encoder meets the walk that the
# tacho's noise of 0.06 rad/s makes at 1 kHz
_SIDE = 14
# samples over which the scatter of the steps is taken
_AROUND = 400
# rounds in which what stands out is left out, or in which jumps are taken out
_ROUNDS = 3
_TRIM = 5.0
# three intervals hold this part of a jump at least
_SUDDEN = 0.5
# a glitch of the encoder: out and back within this part, and this many increments' scatter large
_BACK = 0.3
_GLITCH_SIGMA = 16.0
# a spike is this many times what one sample in a hundred differs from the median of five
_SPIKE_RATIO = 2.5
_SPIKE_WINDOW = 5
# and at least this part of the largest speed: rounding of a speed without noise is no spike
_SPIKE_LEAST = 0.01


@dataclass(frozen=True, slots=True)
class Jump:
    """The encoder's angle moves against the tacho's between two samples.

    Parameters
    ----------
    first : int
        First sample after it.
    time_s : float
        Its time, s, between two samples.
    angle_rad, std_rad : float
        Encoder less tacho, rad, and its standard uncertainty.
    before, after : tuple of float
        Velocity, rad/s, and acceleration, rad/s^2, on its two sides.
    """

    first: int
    time_s: float
    angle_rad: float
    std_rad: float
    before: tuple[float, float]
    after: tuple[float, float]


def velocity_spikes(velocity: FloatArray) -> NDArray[np.bool_]:
    """Return isolated samples of the velocity far from their neighbours.

    Parameters
    ----------
    velocity : ndarray, shape (n,)
        Velocity, rad/s; NaN where lost.

    Returns
    -------
    ndarray of bool, shape (n,)
        True at samples that differ from the median of five by 2.5 times what one sample in a
        hundred does, by eight robust standard deviations and by a hundredth of the largest speed.
    """
    from scipy.ndimage import median_filter

    far = np.zeros(len(velocity), dtype=bool)
    at = np.flatnonzero(np.isfinite(velocity))
    if len(at) < 10 * _SPIKE_WINDOW:
        return far
    away = np.abs(velocity[at] - median_filter(velocity[at], size=_SPIKE_WINDOW, mode="nearest"))
    limit = max(
        _SPIKE_RATIO * float(np.quantile(away, 0.99)),
        _GLITCH_SIGMA / 2.0 * robust_std(away),
        _SPIKE_LEAST * float(np.quantile(np.abs(velocity[at]), 0.99)),
    )
    far[at] = away > limit
    return far


def _unlike(shaft: Shaft) -> tuple[FloatArray, float]:
    """Return encoder less tacho increments without scale, drift and lag, and their scatter."""
    good = shaft.good
    regressors = np.column_stack(
        [shaft.by_tacho_rad, np.diff(shaft.time_s), np.diff(shaft.velocity_rad_s)]
    )
    size = np.sqrt(np.mean(regressors[good] ** 2, axis=0))
    regressors = regressors / np.where(size > 0.0, size, 1.0)
    wanted = shaft.by_encoder_rad - shaft.by_tacho_rad
    used = good.copy()
    left = np.zeros(len(good))
    for _ in range(_ROUNDS):
        solution = np.linalg.lstsq(regressors[used], wanted[used], rcond=None)[0]
        left[good] = wanted[good] - regressors[good] @ solution
        scatter = robust_std(left[good])
        limit = max(_TRIM * scatter, _COUNTS * shaft.count_rad)
        used = good & (np.abs(left) <= limit)
    return left, scatter


def _steps(left: FloatArray) -> FloatArray:
    """Return mean level over the samples after less mean level before each increment."""
    total = np.concatenate([[0.0], np.cumsum(left)])
    sums = np.concatenate([[0.0], np.cumsum(total)])
    at = np.arange(len(left))
    low, high = np.maximum(at + 1 - _SIDE, 0), np.minimum(at + 1 + _SIDE, len(left) + 1)
    before = (sums[at + 1] - sums[low]) / (at + 1 - low)
    after = (sums[high] - sums[at + 1]) / (high - at - 1)
    return np.asarray(after - before)


def _scatter_around(steps: FloatArray, good: NDArray[np.bool_]) -> FloatArray:
    """Return the robust scatter of the steps around each increment, at least that of all."""
    everywhere = robust_std(steps[good])
    edges = np.arange(0, len(steps), _AROUND)
    parts = [steps[a : a + _AROUND][good[a : a + _AROUND]] for a in edges.tolist()]
    local = np.array([robust_std(part) if len(part) > _SIDE else everywhere for part in parts])
    return np.repeat(np.maximum(local, everywhere), _AROUND)[: len(steps)]


def _least(shaft: Shaft) -> FloatArray:
    """Return the step that counting, the tacho's converter and late stamps make, rad."""
    steps = np.diff(shaft.time_s)
    period = float(np.median(steps))
    rounding = _ROUNDING * shaft.tacho_step_rad_s * period
    least = max(_COUNTS * shaft.count_rad, rounding, _SMALLEST_RAD)
    late = float(np.quantile(steps, 0.99)) - period
    speed = np.abs(np.nan_to_num(0.5 * (shaft.velocity_rad_s[1:] + shaft.velocity_rad_s[:-1])))
    return np.asarray(np.maximum(least, _LATE * late * speed))


def find_jumps(shaft: Shaft) -> list[Jump]:
    """Return the moments where encoder and tacho part for good.

    Parameters
    ----------
    shaft : Shaft
        Increments by both.

    Returns
    -------
    list of Jump
        In order of time. A jump happens within three sampling intervals, lasts over fourteen
        samples on each side, and is larger than seven standard deviations and than counting makes,
        beside what a velocity that leaves its course for a sample leaves open.

    Notes
    -----
    Scale, drift and lag of the tacho are fitted first, without what stands out: a wrong tacho
    gain, an offset or a filter in the tacho is no jump.
    """
    if int(shaft.good.sum()) < 4 * _SIDE:
        return []
    left, _ = _unlike(shaft)
    steps = _steps(left)
    scatter = _scatter_around(steps, shaft.good)
    floor = np.maximum(_SIGMA * scatter, _least(shaft)) + unintegrated_rad(shaft)
    sizes = np.zeros(len(left))
    for _ in range(_ROUNDS):
        found = _peaks(left - sizes, floor, shaft.good)
        if not found:
            break
        for at, size in found:
            sizes[at] += size
    jumps = []
    for at in np.flatnonzero(np.abs(sizes) > floor).tolist():
        time = 0.5 * float(shaft.time_s[at] + shaft.time_s[at + 1])
        size, std = float(sizes[at]), float(scatter[at])
        jumps.append(Jump(at + 1, time, size, std, _pace(shaft, at, -1), _pace(shaft, at + 1, 1)))
    return jumps


def _pace(shaft: Shaft, at: int, side: int) -> tuple[float, float]:
    """Return velocity and acceleration at a sample by a line through those on one side of it."""
    rows = at + side * np.arange(_SIDE)
    rows = rows[(rows >= 0) & (rows < len(shaft.time_s))]
    rows = rows[np.isfinite(shaft.velocity_rad_s[rows])]
    if len(rows) < 2:
        return 0.0, 0.0
    time = shaft.time_s[rows] - shaft.time_s[at]
    slope, level = np.polyfit(time, shaft.velocity_rad_s[rows], 1)
    return float(level), float(slope)


def _peaks(left: FloatArray, floor: FloatArray, good: NDArray[np.bool_]) -> list[tuple[int, float]]:
    """Return place and size of the largest sudden step in each stretch where steps stand out."""
    steps = _steps(left)
    inside = np.zeros(len(steps), dtype=bool)
    inside[_SIDE:-_SIDE] = True
    far = np.flatnonzero(good & inside & (np.abs(steps) > floor))
    if not len(far):
        return []
    around = np.convolve(left, np.ones(3), mode="same")
    peaks = []
    for part in np.split(far, np.flatnonzero(np.diff(far) > _SIDE) + 1):
        at = int(part[np.argmax(np.abs(steps[part]) + np.abs(left[part]))])
        # a ramp, such as a filter's, spreads over many intervals
        if around[at] * steps[at] > 0.0 and abs(around[at]) > _SUDDEN * abs(steps[at]):
            peaks.append((at, float(steps[at])))
    return peaks


def encoder_glitches(shaft: Shaft) -> NDArray[np.bool_]:
    """Return single samples at which the angle leaves its course and comes back.

    Parameters
    ----------
    shaft : Shaft
        Increments by encoder and tacho.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    wrong = np.zeros(len(shaft.time_s), dtype=bool)
    if int(shaft.good.sum()) < 4 * _SIDE:
        return wrong
    left, scatter = _unlike(shaft)
    usual = _SPIKE_RATIO * float(np.quantile(np.abs(left[shaft.good]), 0.99))
    least = np.maximum(_least(shaft), max(_GLITCH_SIGMA * scatter, usual))
    there = np.abs(left) > least
    back = there[1:] & there[:-1] & (np.abs(left[1:] + left[:-1]) < _BACK * np.abs(left[1:]))
    wrong[1:-1] = back
    return wrong
