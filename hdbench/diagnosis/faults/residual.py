"""Faults that show in what a model leaves: spikes, coarse steps, noise that grows with speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from hdbench.diagnosis.faults.converter import quantisation
from hdbench.diagnosis.faults.fault import Fault, fault_over
from hdbench.diagnosis.faults.scatter import (
    ACCEPT_NATS,
    CERTAIN_NATS,
    find_outliers,
    least_squares,
    paid_nats,
    robust_std,
)
from hdbench.model import Motion
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import ParameterValue

# cells of equal counts over the speed, and blocks in time and over the speed: noise that changes
# with time alone, or with the speed by another law, must not be taken for this one
_CELLS, _BLOCKS = 64, 24
# a wrong form or angle leaves a line that wanders with the speed: so many samples before predict
# it, and no noise
_ORDER = 8


@dataclass(frozen=True, slots=True)
class ResidualFaults:
    """Faults of a residual, its spikes, and the noise of each sample where it grows with speed."""

    faults: tuple[Fault, ...]
    spikes: NDArray[np.bool_]
    noise_variance: FloatArray | None = None  # over its mean


def faults_of_residual(
    residual_nm: FloatArray,
    whitened_residual: FloatArray | None,
    motion: Motion,
    valid: NDArray[np.bool_],
    torque_nm: FloatArray,
    profile: ProfileData,
    *,
    volts: bool,
) -> ResidualFaults:
    """Return the faults of the acquisition that a residual shows.

    `whitened_residual` is None before the noise is known: then spikes and coarse steps alone.
    """
    spikes = find_outliers(residual_nm, valid, torque_nm, whitened_residual)
    faults = [_spiky(spikes, residual_nm, valid, motion.time_s)] if spikes.any() else []
    faults = [one for one in faults if one.evidence_nats > ACCEPT_NATS]
    spikes = spikes if faults else np.zeros_like(spikes)
    kept = valid & ~spikes
    scatter = robust_std(residual_nm[kept])
    readings = np.where(valid, torque_nm, np.nan)
    coarse = quantisation(motion.time_s, readings, scatter, profile, volts=volts)
    if coarse is not None:
        faults.append(coarse)
    # readings of a coarse converter are rough where they cross levels fast
    if whitened_residual is None or coarse is not None:
        return ResidualFaults(tuple(faults), spikes)
    fault, variance = _speed_noise(residual_nm, whitened_residual, kept, motion)
    faults += [] if fault is None else [fault]
    return ResidualFaults(tuple(faults), spikes, variance)


def _spiky(
    spikes: NDArray[np.bool_], residual_nm: FloatArray, valid: NDArray[np.bool_], time_s: FloatArray
) -> Fault:
    """Return the spikes as one fault."""
    scatter = robust_std(residual_nm[valid & ~spikes])
    sizes, times, total = np.abs(residual_nm[spikes]), time_s[spikes], len(spikes)
    # each has a place, a size and a length of its own
    gain = 0.5 * float(np.sum((sizes / max(scatter, 1e-300)) ** 2))
    nats = min(paid_nats(gain, 3 * len(sizes), total), CERTAIN_NATS)
    size, share = float(np.sqrt(np.mean(sizes**2))), len(sizes) / total
    parameters = {
        "share": ParameterValue(share, float(np.sqrt(len(sizes))) / total, "1"),
        "size_nm": ParameterValue(size, size / float(np.sqrt(2.0 * len(sizes))), "N m"),
        "samples": ParameterValue(len(sizes), 0.0, "1"),
        "largest_nm": ParameterValue(float(sizes.max()), scatter, "N m"),
        "first_s": ParameterValue(float(times[0]), None, "s"),
    }
    shape = {"share": share, "size_nm": size}
    return fault_over(
        "spikes", parameters, times, nats, shape=shape, masked=spikes, domain="outliers"
    )


def _innovations(white: FloatArray, good: NDArray[np.bool_]) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return what the samples before do not predict, block by block, and its samples."""
    windows = np.lib.stride_tricks.sliding_window_view(np.where(good, white, 0.0), _ORDER + 1)
    rows = np.flatnonzero(good[_ORDER:])
    left = np.zeros(len(good))
    for block in np.array_split(rows, max(1, len(rows) // 512)):
        before, now = windows[block, :-1], windows[block, -1]
        left[block + _ORDER] = now - before @ least_squares(before, now)
    return left, rows + _ORDER


def _speed_noise(
    residual_nm: FloatArray, whitened: FloatArray, used: NDArray[np.bool_], motion: Motion
) -> tuple[Fault | None, FloatArray | None]:
    """Return noise that grows with the speed, by greatest likelihood, and its variance.

    No fault where the noise changes with the speed by another law, as in motion and at rest; no
    variance either where it does not change.
    """
    left, rows = _innovations(whitened, used & np.isfinite(motion.velocity_rad_s))
    speed = motion.velocity_rad_s**2
    if len(rows) < 500 or not float(np.ptp(speed[rows])) > 0.0:
        return None, None
    # the bulk of cells of equal counts over the speed decides: held samples and other outliers are
    # none of the noise; it ends at 3.7 times the median size, 2.5 deviations of normal noise
    cells = np.array_split(rows[np.argsort(speed[rows], kind="stable")], _CELLS)
    sizes = np.abs(left)
    cells = [cell[sizes[cell] <= 3.7 * float(np.median(sizes[cell]))] for cell in cells]
    bulk = np.sort(np.concatenate(cells))
    squares = left**2 / float(np.mean(left[bulk] ** 2))
    count, means, pace = np.array([(len(c), squares[c].mean(), speed[c].mean()) for c in cells]).T
    design = np.column_stack([np.ones(len(cells)), pace / pace.max()])
    values = np.array([0.5, 0.5])
    # Fisher scoring converges within ten rounds
    for _ in range(20):
        weighted = design * (0.5 * count / (design @ values) ** 2)[:, None]
        fisher = weighted.T @ design
        # a variance stays positive: a thousandth of the mean is none
        values = np.maximum(np.linalg.solve(fisher, weighted.T @ means), 1e-3)
    variance = design @ values
    gain = 0.5 * float(np.sum(count * (means - np.log(variance) - means / variance)))
    by_speed = np.array_split(bulk[np.argsort(speed[bulk], kind="stable")], _BLOCKS)
    blocks = [
        np.array([squares[part].mean() for part in parts])
        for parts in (np.array_split(bulk, _BLOCKS), by_speed)
    ]
    free = [-0.5 * len(bulk) * float(np.mean(np.log(means))) for means in blocks]
    # squares of normal values have a variance of 2, those of the bulk less
    gain, *free = (one * 2.0 / float(np.var(squares[bulk])) for one in (gain, *free))
    chance, nats = float(ndtr(-np.sqrt(2.0 * max(gain, 0.0)))), paid_nats(gain, 1, len(bulk))
    over_time, over_speed = (paid_nats(one, _BLOCKS - 1, len(bulk)) for one in free)
    if max(nats, over_speed) < max(ACCEPT_NATS, over_time):
        return None, None
    speed = np.where(np.isfinite(speed), speed, 0.0)
    if over_speed > nats:
        return None, np.interp(speed, [float(speed[part].mean()) for part in by_speed], blocks[1])
    # variance still + slope w^2 in units of its mean, w in rad/s
    still, slope = float(values[0]), float(values[1] / pace.max())
    power = float(np.mean(residual_nm[used] ** 2))
    # the law of the catalogue states the noise at 100 rad/s
    size = 100.0 * float(np.sqrt(slope * power))
    std = 0.5 * size * float(np.sqrt(np.linalg.inv(fisher)[1, 1])) / float(values[1])
    parameters = {
        "noise_nm": ParameterValue(size, std, "N m"),
        "noise_at_rest_nm": ParameterValue(float(np.sqrt(still * power)), None, "N m"),
    }
    times, shape = motion.time_s[used], {"noise_nm": size}
    share = slope * float(np.mean(speed[used]))
    # it is looked for in one place only: the test of its slope says how sure it is
    fault = fault_over(
        "speed-dependent-noise", parameters, times, nats, false_alarm_probability=chance,
        shape=shape, domain="variance", share=share,
    )  # fmt: skip
    return fault, still + slope * speed
