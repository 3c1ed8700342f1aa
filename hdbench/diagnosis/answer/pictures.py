"""Arrays from which the pictures of a diagnosis are drawn."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.answer.result import Pictures
from hdbench.diagnosis.answer.spectra import peak_spectrum
from hdbench.diagnosis.fit.jointfit import JointFit
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.search import Found
from hdbench.model import BenchModel
from hdbench.records.trace import FloatArray

__all__ = ["pictures_of"]


def pictures_of(
    record: Record, models: tuple[BenchModel, BenchModel], found: Found, baseline: JointFit
) -> Pictures:
    """Return measured, simulated and residual torque, motion and spectra.

    Parameters
    ----------
    record : Record
        Record.
    models : tuple of BenchModel
        Model as given, and extended.
    found : Found
        Result of the search.
    baseline : JointFit
        Fit of the baseline alone.

    Returns
    -------
    Pictures
    """
    motion = record.motion

    def unused_as_nan(values: FloatArray) -> FloatArray:
        return np.where(record.valid, values, np.nan)

    spectra = tuple(
        peak_spectrum(scan.domain, scan.unit, found.first_scans, found.last.scans)
        for scan in found.scans
    )
    return Pictures(
        motion.time_s,
        motion.velocity_rad_s,
        record.torque_nm,
        models[0].torque_nm(motion),
        models[1].torque_nm(motion),
        unused_as_nan(record.response_nm - baseline.fitted_nm),
        unused_as_nan(record.response_nm - found.fit.fitted_nm),
        ~record.valid,
        spectra,
        motion.acceleration_rad_s2,
        motion.angle_rad,
        motion.output_angle_rad,
        motion.applied_nm,
    )
