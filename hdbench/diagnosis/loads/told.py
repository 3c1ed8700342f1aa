"""What the settings of a diagnosis of readings tell beside causes."""

from __future__ import annotations

from typing import Any

import numpy as np

from hdbench.diagnosis.loads.extended import forms_of
from hdbench.diagnosis.loads.fit import LoadFit
from hdbench.diagnosis.loads.names import is_outlier
from hdbench.diagnosis.loads.scatter import GainScatter
from hdbench.diagnosis.loads.weigh import Weighing
from hdbench.profile.schema import ProfileData

__all__ = ["outliers_of", "reason_of", "settings_of"]


def outliers_of(fit: LoadFit) -> list[tuple[int, float]]:
    """Return every reading that stands apart.

    Parameters
    ----------
    fit : LoadFit
        Final fit.

    Returns
    -------
    list of (int, float)
        Index of the reading from 0, and how far it stands apart, N m.
    """
    return [
        (round(term.shape["reading"]), float(linear[0]))
        for term, linear in zip(fit.terms, fit.linear, strict=True)
        if is_outlier(term)
    ]


def settings_of(
    weighing: Weighing, profile: ProfileData, scatter: GainScatter | None, folds: str
) -> dict[str, Any]:
    """Return what the answer depends on, JSON-able.

    Parameters
    ----------
    weighing : Weighing
        Final fit and what it is weighed by.
    profile : ProfileData
        Bench: its arm gives the mass that would fit an outlier.
    scatter : GainScatter or None
        Gains that differ without a form.
    folds : str
        What was left out together.

    Returns
    -------
    dict
    """
    fit = weighing.fit
    table = fit.table
    lever = profile.arm.gravity_m_s2 * profile.arm.length_m
    apart = [
        {
            "reading": index + 1,
            "experiment": table.names[table.experiment[index]],
            "torque_nm": float(table.torque_nm[index]),
            "offset_nm": offset,
            "fitting_mass_kg": abs(float(table.torque_nm[index]) + offset) / lever,
        }
        for index, offset in outliers_of(fit)
    ]
    return {
        "regression": "reading on torque",
        "gain_nm_per_v": 1.0 / fit.slope_v_per_nm,
        "noise": _noise(weighing),
        "readings_used": int(table.used.sum()),
        "time": "time_s" if table.time_measured else "reading number",
        "held_out": folds,
        "forms": forms_of(fit),
        "outliers": apart,
        "gain_scatter": None if scatter is None else scatter.to_dict(),
    }


def _noise(weighing: Weighing) -> dict[str, float | int | None]:
    """Return the scatter about the fit, and what the readings' own samples would make of it."""
    fit = weighing.fit
    own = fit.table.mean_std_v[fit.table.used]
    known = own[np.isfinite(own)]
    volts = float(np.sqrt(np.mean(known**2))) if len(known) else None
    samples = None if volts is None else volts / abs(fit.slope_v_per_nm)
    return {"std_nm": weighing.noise_nm, "dof": fit.dof, "of_samples_nm": samples}


def reason_of(scatter: GainScatter | None) -> str:
    """Return the sentence that tells a scatter of gains that is no finding.

    Parameters
    ----------
    scatter : GainScatter or None
        Gains that differ without a form.

    Returns
    -------
    str
        Empty where there is none, or more than the profile states.
    """
    if scatter is None or not scatter.within_profile:
        return ""
    spread, stated = 100.0 * scatter.relative_std, 100.0 * scatter.expected
    return (
        f"gains differ between {scatter.between} by {spread:.2g} % (standard deviation) "
        f"without a form; the profile states {stated:.2g} %"
    )
