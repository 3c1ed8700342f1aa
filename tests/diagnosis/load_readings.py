"""Readings of a model that was found in readings: whether the model holds all that was fitted."""

from dataclasses import replace

import numpy as np

from hdbench.diagnosis.loads.forms import Term, form_named
from hdbench.diagnosis.loads.table import load_table
from hdbench.model import cause_named

__all__ = ["simulate_loads"]


def simulate_loads(model, loads, profile):
    """Return the readings that the model gives under the same loads; a limit acts last."""
    calibration = model.provenance["calibration"]
    table, _ = load_table(loads, profile)
    zeros = np.array([calibration["zeros_nm"][name] for name in table.names])
    signal = table.torque_nm + zeros[table.experiment]
    for term in sorted(model.causes, key=lambda t: "limit_nm" in t.shape):
        cause = cause_named(term.name, where="model", extra=model.extra_causes)
        form = form_named(cause, calibration["forms"].get(term.name, ""), term.shape)
        columns = Term(form, dict(term.shape)).columns(table.with_signal(signal))
        signal = signal + columns @ np.array(term.linear)[: len(form.parameters)]
    volts = (signal / calibration["gain_nm_per_v"]).tolist()
    readings = zip(loads.readings, volts, strict=True)
    return replace(loads, readings=tuple(replace(r, reading_v=v) for r, v in readings))
