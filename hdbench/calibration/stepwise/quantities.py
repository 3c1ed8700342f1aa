"""Quantities of one group step by step, and their uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

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
    """Quantities of EURAMET cg-14 for one group; volts, per step. None where not defined."""

    # shape (m,): Y: mean deflection over the positions, increasing torque
    mean_v: FloatArray
    # Y^h: mean of increasing and decreasing torque
    mean_both_v: FloatArray | None
    # b': difference between series in one mounting
    repeatability_v: FloatArray | None
    # b: standard deviation over the positions
    reproducibility_v: FloatArray | None
    # largest less smallest over the positions, as BS 7882 and ISO 376 define it
    range_v: FloatArray | None
    # h: mean absolute difference of decreasing and increasing torque
    reversibility_v: FloatArray | None
    # f0: largest change of the zero over a series
    zero_v: float | None
    # slope of the line through zero on Y, V/(N m)
    linear: float
    # the same on Y^h
    linear_both: float | None
    # shape (3,): Coefficients a, b, c of a T + b T^2 + c T^3 on Y
    cubic: FloatArray | None
    # positions behind Y; series behind h
    n_positions: int
    n_both: int
    # shape (m,): Positions that were read at each step
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
    up = _present([s.up_v for s in first])
    both = _present([(s.up_v + s.down_v) / 2.0 for s in first])
    reversed_v = _present([np.abs(s.up_v - s.down_v) for s in group.series])
    n_at = up.count(axis=0)
    mean = _filled(up.mean(axis=0))
    mean_both = _filled(both.mean(axis=0)) if both.count(axis=0).all() else None
    several = n_at > 1
    return StepQuantities(
        mean_v=mean,
        mean_both_v=mean_both,
        repeatability_v=_repeatability(group),
        reproducibility_v=_filled(up.std(axis=0, ddof=1)) if several.any() else None,
        range_v=np.where(several, _filled(up.max(axis=0) - up.min(axis=0)), np.nan)
        if several.any()
        else None,
        reversibility_v=_filled(reversed_v.mean(axis=0)) if reversed_v.count() else None,
        zero_v=_zero(group),
        linear=_through_zero(group.torque_nm, mean),
        linear_both=None if mean_both is None else _through_zero(group.torque_nm, mean_both),
        cubic=_cubic(group.torque_nm, mean),
        n_positions=len(first),
        n_both=int((reversed_v.count(axis=1) > 0).sum()),
        n_at=n_at,
    )


def _present(rows: list[FloatArray]) -> np.ma.MaskedArray[Any, np.dtype[np.float64]]:
    """Return the rows as a table in which what is not there does not count."""
    return np.ma.masked_invalid(np.vstack(rows))


def _filled(values: np.ma.MaskedArray[Any, np.dtype[np.float64]]) -> FloatArray:
    return np.asarray(np.ma.filled(values, np.nan), dtype=float)


def _repeatability(group: StepGroup) -> FloatArray | None:
    """Return the widest difference of series in one mounting that reached every step."""
    mounted: dict[tuple[int, int | None], list[LoadSeries]] = {}
    for series in group.series:
        mounted.setdefault((series.position, series.mounting), []).append(series)
    spans = [
        np.ptp(np.vstack([s.up_v for s in members]), axis=0)
        for members in mounted.values()
        if len({s.repeat for s in members}) > 1
    ]
    whole = [span for span in spans if np.isfinite(span).all()]
    return np.asarray(np.max(np.vstack(whole), axis=0)) if whole else None


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
    own = {}
    if found.cubic is not None:
        powers = np.column_stack([torque_nm, torque_nm**2, torque_nm**3])
        own["fit"] = _over(found.mean_v - powers @ found.cubic, found.mean_v) / _TRIANGULAR
    added = np.zeros(len(torque_nm))
    return _uncertainties(
        found, found.mean_v, (torque_nm, relative_torque), resolution_v, own, added
    )


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
    own = {}
    if found.reversibility_v is not None:
        own["reversibility"] = _over(found.reversibility_v, both) / _RECTANGULAR
    added = _over(both - slope * torque_nm, both)
    return _uncertainties(found, both, (torque_nm, relative_torque), resolution_v, own, added)


def _over(values: FloatArray, deflection_v: FloatArray) -> FloatArray:
    """Return sizes relative to a deflection, NaN where that is 0."""
    return np.abs(values / np.where(deflection_v == 0.0, np.nan, deflection_v))


def _uncertainties(
    found: StepQuantities,
    deflection_v: FloatArray,
    torque: tuple[FloatArray, FloatArray],
    resolution_v: float | None,
    own: dict[str, FloatArray],
    added: FloatArray,
) -> list[StepUncertainty | None]:
    """Return the uncertainty of each step; `torque` in N m, and its relative uncertainty."""
    torque_nm, relative_torque = torque
    out: list[StepUncertainty | None] = []
    for k, y in enumerate(deflection_v.tolist()):
        if not (math.isfinite(y) and y != 0.0):
            out.append(None)
            continue
        parts = _common(found, k, y, float(relative_torque[k]), resolution_v)
        parts |= {name: float(sizes[k]) for name, sizes in own.items()}
        out.append(_case(parts, int(found.n_at[k]), float(added[k]), float(torque_nm[k])))
    return out


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
