"""Data for the pictures of a diagnosis of calibration loads."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdbench.diagnosis.answer.result import LoadPictures

if TYPE_CHECKING:
    from hdbench.diagnosis.loads.fit import LoadFit

__all__ = ["LoadPictures", "load_pictures"]


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
