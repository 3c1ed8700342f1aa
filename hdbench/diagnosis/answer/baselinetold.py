"""What the baseline took, and what this motion cannot tell from it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hdbench.diagnosis.answer.result import NamedCause
from hdbench.diagnosis.fit.jointfit import JointFit
from hdbench.diagnosis.fit.normal import normal_solve
from hdbench.diagnosis.fit.terms import Term, term_columns
from hdbench.diagnosis.measured.record import Record
from hdbench.model import Cause, catalogue, shape_bounds
from hdbench.records.trace import FloatArray

__all__ = ["baseline_told"]

# share of an effect of its own below which it is not told apart, as plans count it
_CONFUSABLE = 0.25
# mean square of a column that this motion shows nothing of
_RANK = 1e-9


def baseline_told(
    record: Record, fit: JointFit, named: Sequence[NamedCause]
) -> dict[str, list[dict[str, Any]]]:
    """Return what the baseline took, and what this motion cannot tell from it.

    Parameters
    ----------
    record : Record
        Record.
    fit : JointFit
        Final fit.
    named : sequence of NamedCause
        Causes that were named: they stood out.

    Returns
    -------
    dict
        ``baseline_ripple``: ``order``, ``amplitude_nm`` and ``std_nm``, the standard uncertainty
        along the amplitude, of each order of the baseline. ``not_told_from_zero``: ``cause`` and
        ``own_share`` of each effect of the speed of whose mean square less than a quarter is left
        beside a zero, as in a motion in one direction or at one speed; empty where the baseline has
        no zero.
    """
    names = {name for cause in named for name in (*cause.group, *cause.rivals)}
    return {
        "baseline_ripple": _ripple(record, fit),
        "not_told_from_zero": _like_zero(record, names),
    }


def _ripple(record: Record, fit: JointFit) -> list[dict[str, Any]]:
    _, inverse = normal_solve(fit.normal.gram, fit.normal.right)
    told: list[dict[str, Any]] = []
    for at, name in enumerate(record.names):
        parts = name.split(":")
        if len(parts) != 3 or parts[0] != "ripple" or parts[2] != "cosine":
            continue
        pair = [at, at + 1]
        value = fit.base[pair]
        amplitude = float(np.hypot(*value))
        along = value / amplitude if amplitude > 0.0 else np.array([1.0, 0.0])
        variance = float(along @ inverse[np.ix_(pair, pair)] @ along)
        told.append(
            {
                "order": float(parts[1]),
                "amplitude_nm": amplitude,
                "std_nm": float(np.sqrt(max(variance, 0.0))),
            }
        )
    return told


def _like_zero(record: Record, named: set[str]) -> list[dict[str, Any]]:
    told: list[dict[str, Any]] = []
    if "zero" not in record.names:
        return told
    for cause in catalogue().values():
        if cause.locked_to != "velocity" or cause.name in named:
            continue
        own = _own_share(record, cause)
        if own is not None and own < _CONFUSABLE:
            told.append({"cause": cause.name, "own_share": own})
    return told


def _own_share(record: Record, cause: Cause) -> float | None:
    """Return the share of an effect that no zero imitates, None where it is not seen."""
    bounds = shape_bounds(cause, record.motion)
    if any(not bands for bands in bounds.values()):
        return None
    shape = {name: bands[0][0] for name, bands in bounds.items()}
    columns = term_columns(Term(cause, shape), record)[record.valid]
    if columns.shape[1] != 1 or not np.isfinite(columns).all():
        return None
    return _spread(columns[:, 0])


def _spread(column: FloatArray) -> float | None:
    square = float(np.mean(column**2))
    return float(column.var()) / square if square > _RANK else None
