"""Relative uncertainty of each step, with and without unloading, in the manner of cg-14."""

from __future__ import annotations

import math

import numpy as np

from hdbench.calibration.budget import combined, expanded_uncertainty
from hdbench.calibration.stepwise.quantities import StepQuantities
from hdbench.records.trace import FloatArray
from hdbench.results.calibration import StepUncertainty

# the guide's fixed coverage factor
_GUIDE_FACTOR = 2.0
_RECTANGULAR, _TRIANGULAR, _RESOLUTION = math.sqrt(12.0), math.sqrt(24.0), math.sqrt(6.0)


def case_one(
    found: StepQuantities,
    torque_nm: FloatArray,
    relative_torque: FloatArray,
    resolution_v: float | None,
) -> list[StepUncertainty | None]:
    """Return the uncertainty for increasing torque and a cubic through zero.

    Notes
    -----
    ``w^2 = w_KE^2 + (r/Y)^2/6 + (b'/Y)^2/12 + (b/Y)^2/n + (f0/Y_E)^2/12 + (fa/Y)^2/24``, all
    full spans; b with n - 1 degrees of freedom.
    """
    fitted = _cubic_deviation(found, torque_nm)
    out: list[StepUncertainty | None] = []
    for k, y in enumerate(found.mean_v):
        if not _usable(float(y)):
            out.append(None)
            continue
        parts = _common(found, k, float(y), float(relative_torque[k]), resolution_v)
        if fitted is not None:
            parts["fit"] = abs(float(fitted[k])) / _TRIANGULAR
        out.append(_case(parts, int(found.n_at[k]), 0.0, float(torque_nm[k])))
    return out


def case_two(
    found: StepQuantities,
    torque_nm: FloatArray,
    relative_torque: FloatArray,
    resolution_v: float | None,
) -> list[StepUncertainty | None] | None:
    """Return the uncertainty for increasing and decreasing torque and a line through zero.

    Notes
    -----
    As `case_one` relative to Y^h, with ``(h/Y^h)^2/12`` for the fit; the deviation from the line
    is known and systematic and is added to the expanded uncertainty: ``W' = k w + |fa|/Y^h``.
    """
    both, slope = found.mean_both_v, found.linear_both
    if both is None or slope is None:
        return None
    out: list[StepUncertainty | None] = []
    for k, y in enumerate(both):
        if not _usable(float(y)):
            out.append(None)
            continue
        parts = _common(found, k, float(y), float(relative_torque[k]), resolution_v)
        if found.reversibility_v is not None:
            parts["reversibility"] = abs(float(found.reversibility_v[k] / y)) / _RECTANGULAR
        added = abs(float(y) - slope * float(torque_nm[k])) / abs(float(y))
        out.append(_case(parts, int(found.n_at[k]), added, float(torque_nm[k])))
    return out


def _usable(deflection_v: float) -> bool:
    return math.isfinite(deflection_v) and deflection_v != 0.0


def _cubic_deviation(found: StepQuantities, torque_nm: FloatArray) -> FloatArray | None:
    if found.cubic is None:
        return None
    powers = np.column_stack([torque_nm, torque_nm**2, torque_nm**3])
    known = np.where(found.mean_v == 0.0, np.nan, found.mean_v)
    return np.asarray((found.mean_v - powers @ found.cubic) / known)


def _common(
    found: StepQuantities, k: int, y: float, torque: float, resolution_v: float | None
) -> dict[str, float]:
    parts = {"torque": torque}
    if resolution_v is not None:
        parts["resolution"] = abs(resolution_v / y) / _RESOLUTION
    if found.repeatability_v is not None:
        parts["repeatability"] = abs(float(found.repeatability_v[k]) / y) / _RECTANGULAR
    if found.reproducibility_v is not None and found.n_at[k] > 1:
        spread = abs(float(found.reproducibility_v[k]) / y)
        parts["reproducibility"] = spread / math.sqrt(int(found.n_at[k]))
    if found.zero_v is not None:
        parts["zero"] = abs(found.zero_v / (found.full_v or math.nan)) / _RECTANGULAR
    return parts


def _case(
    sizes: dict[str, float], n_positions: int, added: float, torque_nm: float
) -> StepUncertainty:
    # a source without data at this step has no part in it
    parts = {name: size for name, size in sizes.items() if math.isfinite(size)}
    free = {"reproducibility": float(n_positions - 1)}
    std, dof = combined([(size, free.get(name)) for name, size in parts.items()])
    own, guide = expanded_uncertainty(std, dof), _GUIDE_FACTOR * std
    return StepUncertainty(
        parts=parts,
        relative_std=std,
        dof=own.dof,
        expanded_relative_k2=guide,
        expanded_relative_k2_with_deviation=guide + added,
        coverage_factor=own.coverage_factor,
        expanded_relative=own.expanded,
        expanded_relative_with_deviation=own.expanded + added,
        deviation_added=added,
        expanded_nm_k2=(guide + added) * torque_nm,
        expanded_nm=(own.expanded + added) * torque_nm,
    )
