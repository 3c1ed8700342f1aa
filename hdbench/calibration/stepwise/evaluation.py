"""One group of series: quantities, uncertainty and class of each step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.calibration.budget import combined, expanded_uncertainty
from hdbench.calibration.lever import TorqueAccount, relative_std
from hdbench.calibration.lines import series_lack_of_fit
from hdbench.calibration.stepwise.series import LoadSeries, StepGroup
from hdbench.records.trace import FloatArray
from hdbench.results import calibration as record

# a cubic through zero has three coefficients: with as many steps it has no deviation to show
_CUBIC = 3


@dataclass(frozen=True, slots=True)
class StepQuantities:
    """Quantities of EURAMET cg-14 for one group; volts, per step. NaN where not defined."""

    # shape (m,): applied torque, N m
    torque_nm: FloatArray
    # Y: mean deflection over the positions, increasing torque
    mean_v: FloatArray
    # Y^h: mean of increasing and decreasing torque
    mean_both_v: FloatArray
    # b': difference between series in one mounting
    repeatability_v: FloatArray
    # b: standard deviation over the positions
    reproducibility_v: FloatArray
    # largest less smallest over the positions, as BS 7882 and ISO 376 define it
    range_v: FloatArray
    # h: mean absolute difference of decreasing and increasing torque
    reversibility_v: FloatArray
    # f0: largest change of the zero over a series
    zero_v: float
    # slope of the line through zero on Y, V/(N m)
    linear: float
    # the same on Y^h
    linear_both: float
    # shape (3,): Coefficients a, b, c of a T + b T^2 + c T^3 on Y
    cubic: FloatArray
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
    mean_both = np.where(both.count(axis=0).all(), _filled(both.mean(axis=0)), np.nan)
    return StepQuantities(
        torque_nm=group.torque_nm,
        mean_v=mean,
        mean_both_v=mean_both,
        repeatability_v=_repeatability(group),
        reproducibility_v=_filled(up.std(axis=0, ddof=1)),
        range_v=np.where(n_at > 1, _filled(up.max(axis=0) - up.min(axis=0)), np.nan),
        reversibility_v=_filled(reversed_v.mean(axis=0)),
        zero_v=_zero(group),
        linear=_through_zero(group.torque_nm, mean),
        linear_both=_through_zero(group.torque_nm, mean_both),
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


def _repeatability(group: StepGroup) -> FloatArray:
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
    nothing = np.full(len(group.torque_nm), np.nan)
    return np.asarray(np.max(np.vstack(whole), axis=0)) if whole else nothing


def _zero(group: StepGroup) -> float:
    changes = [
        abs(s.zero_after_v - s.zero_before_v)
        for s in group.series
        if s.zero_after_v is not None and s.zero_before_v is not None
    ]
    return max(changes, default=math.nan)


def _through_zero(torque: FloatArray, deflection: FloatArray) -> float:
    known = np.isfinite(deflection)
    t, x = torque[known], deflection[known]
    return float(t @ x) / float(t @ t) if len(t) else float("nan")


def _cubic(torque: FloatArray, deflection: FloatArray) -> FloatArray:
    known = np.isfinite(deflection)
    if int(known.sum()) <= _CUBIC:
        return np.full(_CUBIC, np.nan)
    # powers of the share of the largest torque: the columns are then of one size
    top = float(torque.max())
    share = torque[known] / top
    design = np.column_stack([share, share**2, share**3])
    found = np.linalg.lstsq(design, deflection[known], rcond=None)[0]
    return np.asarray(found / np.array([top, top**2, top**3]))


# the guide's fixed coverage factor
_GUIDE_FACTOR = 2.0
_RECTANGULAR, _TRIANGULAR, _RESOLUTION = math.sqrt(12.0), math.sqrt(24.0), math.sqrt(6.0)


def step_uncertainties(
    found: StepQuantities, relative: FloatArray, resolution_v: float | None, *, unloaded: bool
) -> list[record.StepUncertainty | None]:
    """Return the uncertainty of each step, None where there is no deflection.

    Notes
    -----
    Case I, increasing torque and a cubic through zero:
    ``w^2 = w_KE^2 + (r/Y)^2/6 + (b'/Y)^2/12 + (b/Y)^2/n + (f0/Y_E)^2/12 + (fa/Y)^2/24``, all
    full spans; b with n - 1 degrees of freedom.

    Case II, decreasing torque too and a line through zero: the same relative to Y^h, with
    ``(h/Y^h)^2/12`` for the fit; the deviation from the line is known and systematic and is added
    to the expanded uncertainty: ``W' = k w + |fa|/Y^h``.
    """
    torque, y = found.torque_nm, found.mean_both_v if unloaded else found.mean_v
    parts = {
        "torque": relative,
        "resolution": _over(math.nan if resolution_v is None else resolution_v, y) / _RESOLUTION,
        "repeatability": _over(found.repeatability_v, y) / _RECTANGULAR,
        "reproducibility": _over(found.reproducibility_v, y) / np.sqrt(found.n_at),
        "zero": _over(found.zero_v, np.full(len(y), found.full_v)) / _RECTANGULAR,
    }
    if unloaded:
        parts["reversibility"] = _over(found.reversibility_v, y) / _RECTANGULAR
        added = _over(y - found.linear_both * torque, y)
    else:
        powers = np.column_stack([torque, torque**2, torque**3])
        parts["fit"] = _over(y - powers @ found.cubic, y) / _TRIANGULAR
        added = np.zeros(len(torque))
    return [
        _case(
            {name: float(sizes[k]) for name, sizes in parts.items()},
            int(found.n_at[k]),
            float(added[k]),
            float(torque[k]),
        )
        if math.isfinite(deflection) and deflection != 0.0
        else None
        for k, deflection in enumerate(y.tolist())
    ]


def _over(values: FloatArray | float, deflection_v: FloatArray) -> FloatArray:
    """Return sizes relative to a deflection, NaN where that is 0."""
    return np.abs(values / np.where(deflection_v == 0.0, np.nan, deflection_v))


def _case(
    sizes: dict[str, float], n_positions: int, added: float, torque_nm: float
) -> record.StepUncertainty:
    # a source without data at this step has no part in it
    parts = {name: size for name, size in sizes.items() if math.isfinite(size)}
    free = {"reproducibility": float(n_positions - 1)}
    std, dof = combined([(size, free.get(name)) for name, size in parts.items()])
    own, guide = expanded_uncertainty(std, dof), _GUIDE_FACTOR * std
    return record.StepUncertainty(
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


CLASSES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
# limit of each criterion in a class c, share of the deflection: c/2 %, c %, c/4 %, c/2 %, 1.25 c %;
# of the applied torque (k = 2): c/5 %. The published table rounds two of them upwards.
_FACTORS = {
    "repeatability": 0.5,
    "reproducibility": 1.0,
    "zero": 0.25,
    "fit": 0.5,
    "reversibility": 1.25,
    "torque": 0.2,
}
_ROUNDED = {("reversibility", 0.05): 0.063e-2, ("reversibility", 0.5): 0.63e-2}
# smallest torque over resolution in class c is 200/c
_RESOLUTION_STEPS = 200.0
# limits and values are decimal fractions: equality up to rounding is within the limit
_ROUNDING = 1e-12


def class_limit(name: str, grade: float) -> float:
    """Return the limit of a criterion in a class.

    References
    ----------
    .. [1] In the manner of EURAMET cg-14 v2.0 (2011) and DIN 51309; not checked against the text.
    """
    if name == "resolution":
        return _RESOLUTION_STEPS / grade
    return _ROUNDED.get((name, grade), _FACTORS[name] * grade * 1e-2)


def _criterion(name: str, value: float) -> record.Criterion:
    for grade in CLASSES:
        limit = class_limit(name, grade)
        held = value >= limit if name == "resolution" else value <= limit * (1.0 + _ROUNDING)
        if held:
            return record.Criterion(name=name, value=value, allowed=grade, limit=limit)
    limit = class_limit(name, CLASSES[-1])
    return record.Criterion(name=name, value=value, allowed=None, limit=limit)


def classify(values: dict[str, float | None], needed: Sequence[str]) -> record.Classification:
    """Return the class that the values allow."""
    known = {n: v for n, v in values.items() if v is not None and math.isfinite(v)}
    criteria = tuple(_criterion(name, value) for name, value in known.items())
    missing = tuple(name for name in values if name not in known)
    absent = [name for name in needed if name not in known]
    outside = [c.name for c in criteria if c.allowed is None]
    value = None
    if absent:
        reason = f"no data for {', '.join(absent)}"
    elif outside:
        reason = f"{', '.join(outside)} outside class {CLASSES[-1]:g}"
    else:
        value = max(c.allowed or 0.0 for c in criteria)
        setting = ", ".join(c.name for c in criteria if c.allowed == value)
        without = f"; no data for {', '.join(missing)}" if missing else ""
        reason = f"set by {setting}{without}"
    return record.Classification(value=value, reason=reason, criteria=criteria, missing=missing)


def overall_class(groups: Sequence[record.LoadGroup]) -> record.Classification:
    """Return the worst class of the directions of the widest range."""
    if not groups:
        return record.Classification(value=None, reason="nothing was loaded")
    chosen = [group_class(group) for group in groups if group.range == groups[0].range]
    for one in chosen:
        if one.value is None:
            return one
    return max(chosen, key=lambda one: one.value or 0.0)


def group_class(group: record.LoadGroup) -> record.Classification:
    """Return the class of one group: with reversibility where it was unloaded, too."""
    unloaded = group.linear_up_down_v_per_nm is not None
    found = group.class_increasing_decreasing if unloaded else group.class_increasing
    if found is None:
        raise ValueError(f"the group {group.direction}, {group.range} range has no class")
    return found


def evaluate_group(
    group: StepGroup, account: TorqueAccount, resolution_v: float | None
) -> tuple[record.LoadGroup, tuple[record.LoadStep, ...]]:
    """Evaluate one group in the manner of EURAMET cg-14."""
    found, torque = step_quantities(group), group.torque_nm
    relative = np.array([account.relative_std_at(float(t)) for t in torque])
    one = step_uncertainties(found, relative, resolution_v, unloaded=False)
    two = step_uncertainties(found, relative, resolution_v, unloaded=True)
    first, second = _class_values(found, account, resolution_v)
    needed, top = ("reproducibility",), float(torque[-1])
    sensitivity = float(found.mean_v[-1]) / top
    whole = record.LoadGroup(
        **group.place,
        n_positions=found.n_positions,
        n_series=len(group.series),
        n_series_up_down=found.n_both,
        largest_torque_nm=top,
        sensitivity_v_per_nm=_known(sensitivity),
        gain_nm_per_v=_known(1.0, over=sensitivity),
        gain_up_nm_per_v=_known(1.0, over=found.linear),
        gain_up_down_nm_per_v=_known(1.0, over=found.linear_both),
        linear_v_per_nm=_known(found.linear),
        linear_up_down_v_per_nm=_known(found.linear_both),
        cubic_v=tuple(found.cubic.tolist()) if np.isfinite(found.cubic).all() else None,
        zero_v=_known(found.zero_v),
        zero_relative=_known(found.zero_v, over=found.full_v),
        resolution_v=resolution_v,
        class_increasing=classify(first, needed),
        class_increasing_decreasing=classify(second, (*needed, "reversibility")),
        zero_by_line=tuple(s.id for s in group.series if s.zero_by_line),
        torque_nm=tuple(torque.tolist()),
        series=tuple(_series(s) for s in group.series),
        lack_of_fit=series_lack_of_fit(torque, np.vstack([s.up_v for s in group.series])),
    )
    steps = (
        _step(group, found, k, increasing=one[k], increasing_decreasing=two[k])
        for k in range(len(torque))
    )
    return whole, tuple(steps)


def _step(group: StepGroup, found: StepQuantities, k: int, **uncertainties: Any) -> record.LoadStep:
    torque, y = float(group.torque_nm[k]), float(found.mean_v[k])
    both = float(found.mean_both_v[k])
    volts = {
        "repeatability": float(found.repeatability_v[k]),
        "reproducibility": float(found.reproducibility_v[k]),
        "range": float(found.range_v[k]),
        "reversibility": float(found.reversibility_v[k]),
        "deviation_linear": y - found.linear * torque,
        "deviation_cubic": y - _cubic_at(found, torque),
    }
    sizes: dict[str, Any] = {f"{name}_v": _known(size) for name, size in volts.items()}
    sizes |= {f"{name}_relative": _known(size, over=y) for name, size in volts.items()}
    return record.LoadStep(
        **group.place,
        torque_nm=torque,
        deflection_v=_known(y),
        deflection_up_down_v=_known(both),
        fitted_v=_known(found.linear * torque),
        deviation_up_down_relative=_known(both - found.linear_both * torque, over=both),
        **uncertainties,
        **sizes,
    )


def _class_values(
    found: StepQuantities, account: TorqueAccount, resolution_v: float | None
) -> tuple[dict[str, float | None], dict[str, float | None]]:
    """Return the largest relative values: for increasing torque, and with decreasing torque."""
    torque, y, common = found.torque_nm, found.mean_v, relative_std(account.rows)
    cubic = np.array([_cubic_at(found, float(t)) for t in torque])
    shared = {
        "repeatability": _largest(found.repeatability_v, y),
        "reproducibility": _largest(found.reproducibility_v, y),
        "zero": _known(found.zero_v, over=found.full_v),
        "torque": 2.0 * common if common > 0.0 else None,
        "resolution": None if resolution_v is None else _known(abs(float(y[0])), over=resolution_v),
    }
    both = found.mean_both_v
    first = {**shared, "fit": _largest(y - cubic, y)}
    second = {
        **shared,
        "fit": _largest(both - found.linear_both * torque, both),
        "reversibility": _largest(found.reversibility_v, y),
    }
    return first, second


def _largest(values: FloatArray, y: FloatArray) -> float | None:
    return _known(float(np.max(_over(values, y))))


def _cubic_at(found: StepQuantities, torque: float) -> float:
    a, b, c = (float(x) for x in found.cubic)
    return a * torque + b * torque**2 + c * torque**3


def _series(series: LoadSeries) -> record.GroupSeries:
    volts = {
        name: tuple(_known(float(v)) for v in getattr(series, name)) for name in ("up_v", "down_v")
    }
    return record.GroupSeries.from_json({**asdict(series), **volts}, f"series {series.id}")


def _known(value: float, *, over: float = 1.0) -> float | None:
    """Return value over something, None where either is not known or the second is 0."""
    return value / over if math.isfinite(value) and math.isfinite(over) and over != 0.0 else None
