"""What the fixed part of the baseline is made of: the measured load, and fast noise of both."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.model import Motion, baseline_columns
from hdbench.model.localfit import fit_derivative, smoothed
from hdbench.model.motion import ACCELERATION_WINDOW_S
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

__all__ = ["angle_noise", "fast_noise", "load_share"]

# the angle is smoothed as for the acceleration that is formed of it
_ANGLE_DEGREE = 4
# window of an acceleration that holds a few thousandths of the noise of the usual one
_WIDE = 3.0
# a fast part beyond this many standard deviations of its own is a bend of the channel
_BEND = 5.0
# fast parts below this are rounding of the channels, N m
_ROUNDING_NM = 1e-9


def fast_noise(motion: Motion, load: float) -> FloatArray:
    """Return the fast noise of load and expected torque.

    Parameters
    ----------
    motion : Motion
        Motion.
    load : float
        Coefficient of the measured load.

    Returns
    -------
    ndarray, shape (n_samples, k)
        N m; no column where there is none.
    """
    parts = []
    if motion.load_torque_nm is not None and motion.load_smooth_nm is not None and load != 0.0:
        parts.append(motion.load_torque_nm - motion.load_smooth_nm)
    from_angle = motion.acceleration_source == "angle"
    wide = fit_derivative(
        motion.time_s,
        motion.angle_rad if from_angle else motion.velocity_rad_s,
        derivative=2 if from_angle else 1,
        degree=4 if from_angle else 3,
        window_s=_WIDE * ACCELERATION_WINDOW_S,
    ).derivative
    parts.append(motion.inertia_nm_s2 * (motion.acceleration_rad_s2 - wide))
    columns = [_noise_alone(np.nan_to_num(part), motion.valid) for part in parts]
    kept = [column for column in columns if float(np.abs(column).max()) > _ROUNDING_NM]
    return np.column_stack(kept) if kept else np.zeros((len(motion), 0))


def angle_noise(motion: Motion, names: tuple[str, ...], columns: FloatArray) -> FloatArray:
    """Return what the fast noise of the angle makes of the baseline's ripple.

    The torque ripples with the shaft, the baseline with the angle that was read: an encoder's
    counting steps fold to one frequency at a constant speed, and the ripple over them leaves the
    step times its slope. A delay of the whole torque is made of the same steps.

    Parameters
    ----------
    motion : Motion
        Motion.
    names : tuple of str
        Terms of the baseline, as `baseline_columns` names them.
    columns : ndarray, shape (n_samples, n_names)
        Their columns.

    Returns
    -------
    ndarray, shape (n_samples, k)
        Slope of each ripple column over the angle, times the angle's fast noise, N m per N m of
        the column; no column where there is none.
    """
    angle = np.where(np.isfinite(motion.angle_rad), motion.angle_rad, np.nan)
    slow = smoothed(motion.time_s, angle, degree=_ANGLE_DEGREE, window_s=ACCELERATION_WINDOW_S)
    fast = _noise_alone(np.nan_to_num(angle - slow), motion.valid)
    parts = []
    for name in names:
        kind, _, rest = name.partition(":")
        order, _, phase = rest.partition(":")
        if kind == "ripple" and phase == "cosine":
            cosine = columns[:, names.index(name)]
            sine = columns[:, names.index(f"ripple:{order}:sine")]
            parts += [-float(order) * sine * fast, float(order) * cosine * fast]
    kept = [part for part in parts if float(np.nanmax(np.abs(part))) > _ROUNDING_NM]
    return np.column_stack(kept) if kept else np.zeros((len(motion), 0))


def _noise_alone(part: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Return a fast part without its bends: where it is far from its own scatter it is no noise."""
    # 68.27 % of a normal distribution lie within one standard deviation
    scatter = float(np.quantile(np.abs(part[valid]), 0.6827)) if valid.any() else 0.0
    return np.where(np.abs(part) <= _BEND * scatter, part, 0.0)


def load_share(
    motion: Motion, profile: ProfileData, torque: FloatArray, masked: NDArray[np.bool_]
) -> float:
    """Return the coefficient of the measured load that fits best.

    Parameters
    ----------
    motion : Motion
        Motion.
    profile : ProfileData
        Bench.
    torque : ndarray, shape (n_samples,)
        Measured torque, N m.
    masked : ndarray of bool, shape (n_samples,)
        Samples that are not used.

    Returns
    -------
    float
        1 where the torque channel holds the load, 0 where it does not, -1 where it holds its
        negative.
    """
    if motion.load_torque_nm is None:
        return 1.0
    usable = motion.valid & np.isfinite(torque) & np.isfinite(motion.load_torque_nm) & ~masked
    load = motion.load_torque_nm[usable]
    fixed, _, columns = baseline_columns(motion, profile, load=0.0)
    design, response = columns[usable], (torque - fixed)[usable]
    if not len(load) > design.shape[1] or not float(np.abs(load).max()) > 0.0:
        return 1.0
    both = np.column_stack([response, load])
    left = both - design @ np.linalg.lstsq(design, both, rcond=None)[0]
    share = float(left[:, 0] @ left[:, 1]) / float(left[:, 1] @ left[:, 1])
    # the channel holds the load unless half of it is missing
    return 1.0 if share > 0.5 else (-1.0 if share < -0.5 else 0.0)
