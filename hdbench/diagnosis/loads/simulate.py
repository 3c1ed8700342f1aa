"""Readings as an extended model would give them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.forms import in_form
from hdbench.diagnosis.loads.shapes import columns_of, with_simulated
from hdbench.diagnosis.loads.table import load_table
from hdbench.errors import DataError
from hdbench.model import BenchModel, cause_named
from hdbench.profile.schema import ProfileData
from hdbench.records import Loads

__all__ = ["simulate_loads"]


def simulate_loads(model: BenchModel, loads: Loads, profile: ProfileData) -> Loads:
    r"""Return the readings that a model found in readings gives under the same loads.

    Parameters
    ----------
    model : BenchModel
        Extended model with ``provenance["calibration"]``: gain, zeros and forms.
    loads : Loads
        Readings whose loads, positions and times are used.
    profile : ProfileData
        Bench.

    Returns
    -------
    Loads
        The same with ``reading_v`` of the model; an experiment that the model does not know has the
        zero 0.

    Raises
    ------
    DataError
        If the model has no calibration, or a cause does not fit the catalogue.

    Notes
    -----
    .. math:: V_n = (\tau_n + z_{e(n)} + \sum_j c_j) / G

    A limit acts last, on all the rest.
    """
    calibration = model.provenance.get("calibration")
    if not isinstance(calibration, dict) or "gain_nm_per_v" not in calibration:
        raise DataError(
            "the model holds no calibration; needed: gain and zeros as found in readings",
            where=loads.source,
            fix="diagnose a loads file and use the model that this writes",
        )
    table = load_table(loads, profile)
    zeros = calibration.get("zeros_nm", {})
    signal = table.torque_nm + np.array(
        [float(zeros.get(table.names[number], 0.0)) for number in table.experiment]
    )
    forms = calibration.get("forms", {})
    for last in (False, True):
        whole = with_simulated(table, signal)
        for term in model.causes:
            if ("limit_nm" in term.shape) == last:
                plain = cause_named(term.name, where="model", extra=model.extra_causes)
                cause = in_form(plain, forms.get(term.name, ""))
                columns = columns_of(Term(cause, dict(term.shape)), whole)
                signal = signal + columns @ np.asarray(term.linear)[: columns.shape[1]]
    volts = (signal / float(calibration["gain_nm_per_v"])).tolist()
    readings = zip(loads.readings, volts, strict=True)
    return replace(loads, readings=tuple(replace(r, reading_v=v) for r, v in readings))
