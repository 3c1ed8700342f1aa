"""Diagnosis of a calibration: one gain common to all experiments and one zero for each."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.preflight import DataFlag
from hdbench.diagnosis.result import Diagnosis
from hdbench.model import BenchModel
from hdbench.profile import Profile
from hdbench.records import FloatArray, Loads

__all__ = ["diagnose_loads"]

# readings beyond the zeros and the gain that a residual needs before anything can be read from it
_LEAST_FREE = 3


def _baseline(loads: Loads) -> tuple[FloatArray, FloatArray]:
    """Return the design (common gain, one zero each) and the applied torque."""
    names = list(dict.fromkeys(reading.experiment for reading in loads.readings))
    design = np.zeros((len(loads), 1 + len(names)))
    for row, reading in enumerate(loads.readings):
        design[row, 0] = reading.reading_v
        design[row, 1 + names.index(reading.experiment)] = 1.0
    return design, np.array([reading.torque_nm for reading in loads.readings])


def _left_out_rms(design: FloatArray, torque: FloatArray) -> float:
    """Return the RMS error of each reading predicted from all others, N m."""
    q = np.linalg.qr(design)[0]
    leverage = np.einsum("nk,nk->n", q, q)
    left = torque - q @ (q.T @ torque)
    free = leverage < 1.0 - 1e-9
    return float(np.sqrt(np.mean((left[free] / (1.0 - leverage[free])) ** 2)))


def diagnose_loads(loads: Loads, profile: Profile) -> Diagnosis:
    """Hold a calibration against its baseline.

    Parameters
    ----------
    loads : Loads
        Static readings.
    profile : Profile
        Bench.

    Returns
    -------
    Diagnosis
        Verdict ``data-bad`` where gain and zeros cannot be fitted; else ``cannot-tell``: the
        residual of the baseline is measured, the static causes of the catalogue are not told
        apart by this version, and the reason says so.

    Notes
    -----
    ``torque = gain * reading + zero_e`` by least squares, e the experiment; the held-out residual
    of a reading is its residual over one less its leverage.
    """
    model = BenchModel.from_profile(profile.data)
    design, torque = _baseline(loads)
    flags: tuple[DataFlag, ...] = ()
    enough = len(torque) >= design.shape[1] + _LEAST_FREE
    if not (enough and np.linalg.matrix_rank(design) == design.shape[1]):
        reason = (
            f"{len(torque)} readings do not fix one gain and {design.shape[1] - 1} zeros; needed: "
            f"{design.shape[1] + _LEAST_FREE} readings under different loads"
        )
        nothing: dict[str, object] = {"terms": [], "heldout_rms_nm": None}
        return Diagnosis("data-bad", (), (), (), (), flags, (), nothing, nothing, model, {}, reason)
    rms = _left_out_rms(design, torque)
    terms = {"terms": ["gain", "zero of each experiment"], "heldout_rms_nm": rms}
    reason = (
        f"one gain and {design.shape[1] - 1} zeros leave {rms:.4g} N m rms on held-out readings; "
        "static causes are not searched in loads: diagnose a dynamic run for causes with names"
    )
    return Diagnosis("cannot-tell", (), (), (), (), flags, (), terms, terms, model, {}, reason)
