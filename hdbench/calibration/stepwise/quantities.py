"""Quantities of one group step by step, and their uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.calibration.budget import combined, expanded_uncertainty
from hdbench.calibration.stepwise.series import LoadSeries, StepGroup
from hdbench.records.trace import FloatArray
from hdbench.results.calibration import StepUncertainty

# a cubic through zero has three coefficients: with as many steps it has no deviation to show
_CUBIC = 3


@dataclass(frozen=True, slots=True)
class StepQuantities:
    """Quantities of EURAMET cg-14 for one group; volts, per step. None where not defined.

    Parameters
    ----------
    mean_v : ndarray, shape (m,)
        Y: mean deflection over the positions, increasing torque.
    mean_both_v : ndarray or None
        Y^h: mean of increasing and decreasing torque.
    repeatability_v : ndarray or None
        b': difference between series in one mounting.
    reproducibility_v : ndarray or None
        b: standard deviation over the positions.
    range_v : ndarray or None
        Largest less smallest over the positions, as BS 7882 and ISO 376 define it.
    reversibility_v : ndarray or None
        h: mean absolute difference of decreasing and increasing torque.
    zero_v : float or None
        f0: largest change of the zero over a series.
    linear : float
        Slope of the line through zero on Y, V/(N m).
    linear_both : float or None
        The same on Y^h.
    cubic : ndarray or None, shape (3,)
        Coefficients a, b, c of a T + b T^2 + c T^3 on Y.
    n_positions, n_both : int
        Positions behind Y; series behind h.
    n_at : ndarray of int, shape (m,)
        Positions that were read at each step.
    """

    mean_v: FloatArray
    mean_both_v: FloatArray | None
    repeatability_v: FloatArray | None
    reproducibility_v: FloatArray | None
    range_v: FloatArray | None
    reversibility_v: FloatArray | None
    zero_v: float | None
    linear: float
    linear_both: float | None
    cubic: FloatArray | None
    n_positions: int
    n_both: int
    n_at: NDArray[np.int64]

    @property
    def full_v(self) -> float:
        """Deflection at the largest torque that was read while loading, V; NaN where none was."""
        known = self.mean_v[np.isfinite(self.mean_v)]
        return float(known[-1]) if len(known) else float("nan")


def step_quantities(group: StepGroup) -> StepQuantities:
    """Return the quantities of one group.

    Notes
    -----
    ``Y_k`` is the mean over *different* positions; a further series in a mounting is left out of
    it and gives ``b'_k = |X_1k - X_2k|`` (the widest pair, where there are more).
    ``b_k^2 = sum_j (X_jk - Y_k)^2 / (n - 1)``. ``h_k`` is the mean over all series with both
    branches. ``f0`` is the largest ``|I_f - I_0|``. Lines through zero: ``S = sum TX / sum T^2``.
    A position whose series lacks a step is left out of that step; a step that one position alone
    has is without b (NaN).

    References
    ----------
    .. [1] In the manner of EURAMET cg-14 v2.0 (2011); not checked against its text.
    """
    first = group.first_series()
    up = _stack([s.up_v for s in first])
    both = _stack([(s.up_v + s.down_v) / 2.0 for s in first])
    mean = _mean(up)
    mean_both = _mean(both) if np.isfinite(both).any(axis=0).all() else None
    return StepQuantities(
        mean_v=mean,
        mean_both_v=mean_both,
        repeatability_v=_repeatability(group),
        reproducibility_v=_spread(up),
        range_v=_range(up),
        reversibility_v=_reversibility(group),
        zero_v=_zero(group),
        linear=_through_zero(group.torque_nm, mean),
        linear_both=None if mean_both is None else _through_zero(group.torque_nm, mean_both),
        cubic=_cubic(group.torque_nm, mean),
        n_positions=len(first),
        n_both=sum(bool(_both(s).any()) for s in group.series),
        n_at=np.isfinite(up).sum(axis=0),
    )


def _stack(rows: list[FloatArray]) -> FloatArray:
    return np.vstack(rows)


def _mean(rows: FloatArray) -> FloatArray:
    """Return the mean over the rows of what is there; NaN where nothing is."""
    there = np.isfinite(rows)
    n = there.sum(axis=0)
    total = np.where(there, rows, 0.0).sum(axis=0)
    return np.asarray(np.where(n > 0, total / np.maximum(n, 1), np.nan), dtype=float)


def _spread(rows: FloatArray) -> FloatArray | None:
    there = np.isfinite(rows)
    n = there.sum(axis=0)
    if not (n > 1).any():
        return None
    off = np.where(there, rows - _mean(rows), 0.0)
    spread = np.sqrt((off**2).sum(axis=0) / np.maximum(n - 1, 1))
    return np.asarray(np.where(n > 1, spread, np.nan))


def _range(rows: FloatArray) -> FloatArray | None:
    there = np.isfinite(rows)
    several = there.sum(axis=0) > 1
    if not several.any():
        return None
    out = np.full(rows.shape[1], np.nan)
    largest = np.where(there, rows, -np.inf)[:, several].max(axis=0)
    out[several] = largest - np.where(there, rows, np.inf)[:, several].min(axis=0)
    return out


def _repeatability(group: StepGroup) -> FloatArray | None:
    mounted: dict[tuple[int, int | None], list[LoadSeries]] = {}
    for series in group.series:
        mounted.setdefault((series.position, series.mounting), []).append(series)
    widest = [
        np.ptp(_stack([s.up_v for s in members]), axis=0)
        for members in mounted.values()
        if len({s.repeat for s in members}) > 1
    ]
    finite = [w for w in widest if np.isfinite(w).all()]
    return np.asarray(np.max(_stack(finite), axis=0)) if finite else None


def _both(series: LoadSeries) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(series.up_v) & np.isfinite(series.down_v))


def _reversibility(group: StepGroup) -> FloatArray | None:
    rows = _stack([np.abs(s.up_v - s.down_v) for s in group.series])
    return _mean(rows) if np.isfinite(rows).any(axis=0).any() else None


def _zero(group: StepGroup) -> float | None:
    changes = [
        abs(s.zero_after_v - s.zero_before_v)
        for s in group.series
        if s.zero_after_v is not None and s.zero_before_v is not None
    ]
    return max(changes) if changes else None


def _through_zero(torque: FloatArray, deflection: FloatArray) -> float:
    known = np.isfinite(deflection)
    t, x = torque[known], deflection[known]
    return float(t @ x) / float(t @ t) if len(t) else float("nan")


def _cubic(torque: FloatArray, deflection: FloatArray) -> FloatArray | None:
    known = np.isfinite(deflection)
    if int(known.sum()) <= _CUBIC:
        return None
    # powers of the share of the largest torque: the columns are then of one size
    top = float(torque.max())
    share = torque[known] / top
    design = np.column_stack([share, share**2, share**3])
    found = np.linalg.lstsq(design, deflection[known], rcond=None)[0]
    return np.asarray(found / np.array([top, top**2, top**3]))


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
