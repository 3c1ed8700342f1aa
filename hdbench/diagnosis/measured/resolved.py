"""Where the measured motion cannot give the expected torque."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.measured.preflight import robust_scatter_nm
from hdbench.diagnosis.measured.record import Record
from hdbench.model.localfit import fit_derivative
from hdbench.model.motion import ACCELERATION_WINDOW_S
from hdbench.profile.schema import ProfileData

__all__ = ["unresolved_motion"]

# local polynomials bridge two lost samples; a longer step ends a stretch
_LONG_GAP = 3.5
# the scatter may be that of a large hidden effect: a fiftieth of it is far below any noise
_UNRESOLVED = 0.02
# the largest of a million normal samples lies near 5 standard deviations, and the wide window adds
# little noise to that of the narrow one
_NOISE_SIGMA = 5.0


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
        True within a window of samples where accelerations over 20 ms and over 40 ms differ by
        more than a fiftieth of the residual's scatter in torque and by more than noise makes, and
        within half a window of an end of a stretch, where the acceleration has many times its
        noise.

    Notes
    -----
    A local polynomial follows smooth motion exactly whatever its window; where the acceleration
    jumps, two windows disagree, and both differ from the truth by as much.
    """
    from scipy.ndimage import maximum_filter1d

    motion, valid = record.motion, record.valid
    from_angle = motion.acceleration_source == "angle"
    wide = fit_derivative(
        motion.time_s,
        motion.angle_rad if from_angle else motion.velocity_rad_s,
        derivative=2 if from_angle else 1,
        degree=4 if from_angle else 3,
        window_s=2.0 * ACCELERATION_WINDOW_S,
    )
    change = np.abs(motion.acceleration_rad_s2 - wide.derivative)
    inertia = profile.drive.load_inertia_kg_m2 / profile.drive.gear_ratio
    limit = max(
        _UNRESOLVED * robust_scatter_nm(record) / inertia,
        _NOISE_SIGMA * float(np.nan_to_num(motion.acceleration_noise_rad_s2)),
    )
    jump = valid & (np.nan_to_num(change) > limit)
    width = 1 + 2 * round(ACCELERATION_WINDOW_S / record.period_s)
    jump = maximum_filter1d(jump.astype(np.uint8), width) > 0
    half = round(0.5 * ACCELERATION_WINDOW_S / record.period_s)
    gaps = np.flatnonzero(np.diff(motion.time_s) > _LONG_GAP * record.period_s) + 1
    for edge in (0, *gaps.tolist(), len(jump)):
        jump[max(0, edge - half) : edge + half] = True
    return np.asarray(jump)
