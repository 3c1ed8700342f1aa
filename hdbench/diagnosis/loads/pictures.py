"""Data for the pictures of a diagnosis of calibration loads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

if TYPE_CHECKING:
    from hdbench.diagnosis.loads.fit import LoadFit

__all__ = ["LoadPictures", "load_pictures"]


@dataclass(frozen=True, slots=True)
class LoadPictures:
    """Everything that a picture of readings needs; arrays of shape (n_readings,).

    Parameters
    ----------
    reading : ndarray of int
        Number of the reading, from 1.
    experiment : tuple of str
        Experiment of each reading.
    time_s : ndarray
        Time, s, or the reading's number from 0 where no time was written.
    torque_nm : ndarray
        Applied torque, N m.
    position_rad : ndarray
        Flexspline position, rad.
    falling : ndarray of bool
        True while unloading.
    used : ndarray of bool
        Readings that the fits used.
    measured_nm, simulated_nm, extended_nm : ndarray
        Readings, baseline and extended model through the fitted gain and zeros, N m.
    residual_before_nm, residual_after_nm : ndarray
        Readings less fitted baseline, and less baseline and causes, N m.
    """

    reading: NDArray[np.int64]
    experiment: tuple[str, ...]
    time_s: FloatArray
    torque_nm: FloatArray
    position_rad: FloatArray
    falling: NDArray[np.bool_]
    used: NDArray[np.bool_]
    measured_nm: FloatArray
    simulated_nm: FloatArray
    extended_nm: FloatArray
    residual_before_nm: FloatArray
    residual_after_nm: FloatArray


def load_pictures(baseline: LoadFit, fit: LoadFit) -> LoadPictures:
    """Return the data of the pictures.

    Parameters
    ----------
    baseline : LoadFit
        Fit of gain, zeros and the given model's causes.
    fit : LoadFit
        Final fit.

    Returns
    -------
    LoadPictures
    """
    table = fit.table
    return LoadPictures(
        reading=np.arange(1, len(table) + 1),
        experiment=tuple(table.names[i] for i in table.experiment.tolist()),
        time_s=table.motion.time_s,
        torque_nm=table.torque_nm,
        position_rad=table.motion.output_angle_rad,
        falling=table.falling,
        used=table.used,
        measured_nm=table.reading_v / fit.slope_v_per_nm,
        simulated_nm=baseline.fitted_v / baseline.slope_v_per_nm,
        extended_nm=fit.fitted_v / fit.slope_v_per_nm,
        residual_before_nm=(table.reading_v - baseline.fitted_v) / baseline.slope_v_per_nm,
        residual_after_nm=(table.reading_v - fit.fitted_v) / fit.slope_v_per_nm,
    )
