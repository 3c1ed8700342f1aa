"""A further cause beside those of a fit."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.diagnosis.loads.families import Family, best_cell
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads
from hdbench.diagnosis.loads.shapes import HELD
from hdbench.diagnosis.loads.space import Space
from hdbench.records.trace import FloatArray

__all__ = ["trial_fit"]

# a limit is held at where it takes all that is above it, of a signal whose zeros stand beside it:
# they settle in this many rounds
_ROUNDS = 4
# ... or when nothing moves by more than a hundred-thousandth: 0.4 mN m of 40 N m
_SETTLED = 1e-5


def trial_fit(family: Family, less: LoadFit, base: FloatArray, space: Space) -> LoadFit | None:
    """Fit the member of a family that explains most beside the terms of a fit.

    Parameters
    ----------
    family : Family
        Family.
    less : LoadFit
        Fit without it.
    base : ndarray, shape (n, p)
        Columns of the baseline.
    space : Space
        What `less` leaves.

    Returns
    -------
    LoadFit or None
        The new term comes last; None where no member has a share that a cause of this name can
        have.
    """
    cell = best_cell(family, less.table, space, less.slope_v_per_nm)
    if cell is None:
        return None
    trial = fit_loads(less.table, base, (*less.terms, cell.term))
    if not any(p.name in HELD for p in cell.term.cause.shape):
        return trial
    for _ in range(_ROUNDS):
        before = cell.term.shape
        cell = best_cell(family, trial.table, space, less.slope_v_per_nm)
        if cell is None or _settled(before, cell.term.shape):
            break
        trial = fit_loads(trial.table, base, (*less.terms, cell.term))
    return trial


def _settled(before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    return all(abs(after[name] - value) <= _SETTLED * abs(value) for name, value in before.items())
