"""Where the measured motion cannot give the expected torque."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.measured.preflight import baseline_residual_nm
from hdbench.diagnosis.measured.record import Record
from hdbench.model.localfit import fit_derivative
from hdbench.model.motion import ACCELERATION_WINDOW_S
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

__all__ = ["unresolved_motion"]

# local polynomials bridge two lost samples; a longer step ends a stretch
_LONG_GAP = 3.5
# squared errors of the expected torque that may stay in the record, in units of the noise's
# variance: half a standard deviation of an effect that had exactly their form
_MOST_LEFT = 0.25
# the largest of a million normal samples lies near 5 standard deviations, and the wide window adds
# little noise to that of the narrow one
_NOISE_SIGMA = 5.0
# the noise is read where the torque changes least: from the quietest quarter of blocks, s
_BLOCK_S = 0.25
_QUIET = 0.25
# 68.27 % of a normal distribution lie within one standard deviation
_NORMAL = 0.6827


def unresolved_motion(record: Record, profile: ProfileData) -> NDArray[np.bool_]:
    """Return samples whose expected torque the measured motion cannot give.

    Parameters
    ----------
    record : Record
        Record.
    profile : ProfileData
        Load inertia and gear ratio.

    Returns
    -------
    ndarray of bool, shape (n_samples,)
        True around the largest jumps of the acceleration, as many as it takes for the rest to
        weigh less than half a standard deviation together, and within half a window of an end of a
        stretch, where the acceleration has many times its noise.

    Notes
    -----
    A local polynomial follows smooth motion exactly whatever its window; where the acceleration
    jumps, windows of 20 ms and of 40 ms disagree, and the narrow one differs from the truth by
    less than both from each other. A difference below five times the acceleration's own noise
    tells nothing. Jumps are where torque is large: what is left out there costs any effect that
    grows with it a part of its own evidence, so that no more of them are left out than matter.
    """
    from scipy.ndimage import binary_closing

    motion, valid = record.motion, record.valid
    from_angle = motion.acceleration_source == "angle"
    wide = fit_derivative(
        motion.time_s,
        motion.angle_rad if from_angle else motion.velocity_rad_s,
        derivative=2 if from_angle else 1,
        degree=4 if from_angle else 3,
        window_s=2.0 * ACCELERATION_WINDOW_S,
    )
    inertia = profile.drive.load_inertia_kg_m2 / profile.drive.gear_ratio
    change = np.nan_to_num(np.abs(motion.acceleration_rad_s2 - wide.derivative))
    noise = _NOISE_SIGMA * float(np.nan_to_num(motion.acceleration_noise_rad_s2))
    errors = np.where(valid & (change > noise), inertia * change, 0.0)
    jump = errors > _tolerable(errors, _quiet_noise_nm(record))
    # between its two flanks the difference of both windows crosses zero
    half = round(ACCELERATION_WINDOW_S / record.period_s)
    jump = binary_closing(np.pad(jump, half), np.ones(1 + 2 * half, dtype=bool))[half:-half]
    edge_width = round(0.5 * ACCELERATION_WINDOW_S / record.period_s)
    gaps = np.flatnonzero(np.diff(motion.time_s) > _LONG_GAP * record.period_s) + 1
    for edge in (0, *gaps.tolist(), len(jump)):
        jump[max(0, edge - edge_width) : edge + edge_width] = True
    return np.asarray(jump)


def _tolerable(errors: FloatArray, noise_nm: float) -> float:
    """Return the size up to which errors may stay, N m: all of them together weigh little."""
    ordered = np.sort(errors)
    weight = np.cumsum(ordered**2)
    within = int(np.searchsorted(weight, _MOST_LEFT * noise_nm**2, side="right"))
    return float(ordered[within - 1]) if within else 0.0


def _quiet_noise_nm(record: Record) -> float:
    """Return the scatter from sample to sample where the torque changes least.

    Parameters
    ----------
    record : Record
        Record.

    Returns
    -------
    float
        N m: the standard deviation of white noise, and less where neighbours are alike. Effects
        that are hidden in the record do not add to it where the shaft is at rest or slow.
    """
    left = baseline_residual_nm(record)
    steps = np.abs(np.diff(left)) / np.sqrt(2.0)
    length = max(20, round(_BLOCK_S / record.period_s))
    whole = len(steps) // length
    if not whole:
        return float(np.quantile(steps, _NORMAL)) if len(steps) else 0.0
    blocks = np.quantile(steps[: whole * length].reshape(whole, length), _NORMAL, axis=1)
    return float(np.quantile(blocks, _QUIET))
