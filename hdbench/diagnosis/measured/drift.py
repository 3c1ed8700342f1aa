"""The drift of an angle that was integrated from a noisy velocity, read from the ripple itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.noise.whitened import make_whitener
from hdbench.estimation import fit_noise
from hdbench.model import Motion, baseline_columns
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

__all__ = ["turned_motion", "without_drift"]

# the drift is one number per block: over 50 ms a tacho noise of 0.06 rad/s at 1 kHz turns the
# angle by 0.4 mrad, that is 0.3 mN m of the profile's ripple
_BLOCK_S = 0.05
# the first round sees the noise with the drift in it, the second sees it without; the third is for
# the curvature of the ripple over drifts of some tenths of a radian
_ROUNDS = 3
# angle by which slopes are formed, rad
_STEP_RAD = 1e-5
# a drift this much rougher than the velocity's noise can make is none: the sum of squares of n
# normal steps lies below n + 10 sqrt(n) but for a chance far below 1e-9
_ROUGH = 10.0
# third differences of white noise have 20 times its variance and none of a smooth motion
_THIRD = 20.0
# a step longer than this many median periods is a gap in time: one lost sample makes 2
_GAP = 1.5


def turned_motion(motion: Motion, angle_rad: FloatArray) -> Motion:
    """Return the motion with another motor angle.

    Parameters
    ----------
    motion : Motion
        Motion.
    angle_rad : ndarray, shape (n_samples,)
        Angle of the wave generator, rad.

    Returns
    -------
    Motion
        An output angle that was not measured turns with it.
    """
    output = motion.output_angle_rad
    if motion.output_source == "motor":
        output = angle_rad / motion.gear_ratio
    return replace(motion, angle_rad=angle_rad, output_angle_rad=output)


@dataclass(frozen=True, slots=True)
class _Sums:
    """Products of whitened columns: over the record, and over each block with the slope."""

    columns: FloatArray
    right: FloatArray
    crossed: FloatArray
    slope: FloatArray
    slope_right: FloatArray


def _walk_per_s(motion: Motion) -> float:
    """Return the variance that the angle's drift gains per second, rad^2/s."""
    velocity = motion.velocity_rad_s[motion.valid]
    if len(velocity) < 8:
        return 0.0
    # 68.27 % of a normal distribution lie within one standard deviation; jumps do not count
    rough = float(np.quantile(np.abs(np.diff(velocity, 3)), 0.6827))
    return rough**2 / _THIRD * float(np.median(np.diff(motion.time_s)))


def _solve(sums: _Sums, precision: float, drift: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return coefficients and change of the drift: a random walk from 0 with Gaussian steps."""
    from scipy.linalg import solveh_banded

    count = len(drift)
    diagonal = np.full(count, 2.0 * precision)
    diagonal[-1] = precision
    band = np.vstack([np.full(count, -precision), diagonal + sums.slope])
    pulled = diagonal * drift
    pulled[1:] -= precision * drift[:-1]
    pulled[:-1] -= precision * drift[1:]
    wanted = sums.slope_right - pulled
    solved = solveh_banded(band, np.column_stack([sums.crossed, wanted]))
    inner, by_wanted = solved[:, :-1], solved[:, -1]
    reduced = sums.columns - sums.crossed.T @ inner
    coefficients = np.linalg.lstsq(reduced, sums.right - sums.crossed.T @ by_wanted, rcond=None)[0]
    return np.asarray(coefficients), np.asarray(by_wanted - inner @ coefficients)


def _columns(
    motion: Motion, profile: ProfileData, orders: tuple[float, ...], usable: NDArray[np.bool_]
) -> FloatArray:
    """Return the columns of the baseline, once per output turn, and of further motor orders."""
    _, names, columns = baseline_columns(motion, profile)
    angles = [order * motion.angle_rad for order in orders]
    if "misalignment:cosine" not in names:
        angles.append(motion.output_angle_rad)
    lines = [wave(angle) for angle in angles for wave in (np.cos, np.sin)]
    return np.where(usable[:, None], np.column_stack([columns, *lines]), 0.0)


def without_drift(
    motion: Motion,
    profile: ProfileData,
    torque: FloatArray,
    usable: NDArray[np.bool_],
    orders: tuple[float, ...] = (),
) -> Motion:
    r"""Return the motion with the drift of an integrated angle taken out.

    Parameters
    ----------
    motion : Motion
        Motion whose angle was integrated from the velocity.
    profile : ProfileData
        Bench.
    torque : ndarray, shape (n_samples,)
        Measured torque, N m.
    usable : ndarray of bool, shape (n_samples,)
        Samples with torque and motion.
    orders : tuple of float
        Motor orders beside the baseline's that carry the drift too.

    Returns
    -------
    Motion
        As given where the velocity has no noise, or where what looks like a drift is rougher than
        that noise can make it: then it is something else, and the search has to find it.

    Notes
    -----
    White noise of a velocity, standard deviation :math:`\sigma` at a period h, makes its integral
    a random walk that gains :math:`\sigma^2 h` of variance per second. The ripple of the baseline
    carries it: :math:`y = B(\theta + d) c + e`, d a random walk of that size in blocks of 50 ms.
    The most probable c and d are solved for together (Gauss-Newton, tridiagonal in d, the noise e
    whitened), three rounds.
    """
    walk = _walk_per_s(motion)
    if not walk > 0.0:
        return motion
    time = motion.time_s
    block = np.floor((time - time[0]) / _BLOCK_S).astype(np.int64)
    count = int(block[-1]) + 1
    precision = 1.0 / (walk * _BLOCK_S)
    centres = time[0] + _BLOCK_S * (np.arange(count) + 0.5)
    drift = np.zeros(count)
    turned = motion
    response = np.where(usable, torque - baseline_columns(motion, profile)[0], 0.0)

    def columns_of(moved: Motion) -> FloatArray:
        return _columns(moved, profile, orders, usable)

    coefficients = np.asarray(np.linalg.lstsq(columns_of(motion), response, rcond=None)[0])
    for _ in range(_ROUNDS):
        sums = _sums(turned, columns_of, response, usable, (block, count, coefficients))
        coefficients, change = _solve(sums, precision, drift)
        drift = drift + change
        turned = turned_motion(motion, motion.angle_rad + np.interp(time, centres, drift))
    steps = np.diff(drift, prepend=0.0)
    rough = precision * float(steps @ steps)
    return turned if rough <= count + _ROUGH * float(np.sqrt(count)) else motion


def _sums(
    motion: Motion,
    columns_of: Callable[[Motion], FloatArray],
    response: FloatArray,
    usable: NDArray[np.bool_],
    state: tuple[NDArray[np.int64], int, FloatArray],
) -> _Sums:
    """Return the sums at a motion; state: block of each sample, their number, coefficients."""
    block, count, coefficients = state
    columns = columns_of(motion)
    ahead = columns_of(turned_motion(motion, motion.angle_rad + _STEP_RAD))
    slope = (ahead - columns) @ coefficients / _STEP_RAD
    steps = np.diff(motion.time_s)
    starts = np.concatenate([[True], steps > _GAP * float(np.median(steps))])
    noise = fit_noise(response - columns @ coefficients, usable, starts=starts)
    whitener = make_whitener(noise, usable, starts)
    white, right, lean = (whitener.apply(x) for x in (columns, response, slope))

    def per_block(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(block, values, minlength=count), dtype=np.float64)

    crossed = np.column_stack([per_block(column * lean) for column in white.T])
    return _Sums(
        white.T @ white, white.T @ right, crossed, per_block(lean**2), per_block(lean * right)
    )
