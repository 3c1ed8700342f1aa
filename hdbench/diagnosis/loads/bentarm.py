"""An arm that bends so far that it loses lever arm: it bends the curve as a limit does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.families import Family
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads, score_nats
from hdbench.records.trace import FloatArray

__all__ = ["BENT_LIKE", "BentArm", "bent_arm"]

# beside its tau abs(tau) an arm that bends far takes a cube that is never positive. Both together
# bend as a limit or a play does.
_BENT = ("arm-sag", "cubic-nonlinearity")
BENT_LIKE = ("saturation", "backlash", "cubic-nonlinearity")
# a limit takes the best of four sharpnesses and pays for none of them: ln 4 nats
_UNPAID_NATS = 1.4


@dataclass(frozen=True, slots=True)
class BentArm:
    """An arm that bends far.

    Parameters
    ----------
    terms : tuple of Term
        Its sag, and the cube that it takes beside it.
    score_nats : float
        Its score, with what its rivals do not pay for.
    """

    terms: tuple[Term, ...]
    score_nats: float

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.terms[0].cause.name


def bent_arm(less: LoadFit, families: Sequence[Family], base: FloatArray) -> BentArm | None:
    """Return an arm that bends so far that it loses lever arm.

    Parameters
    ----------
    less : LoadFit
        Fit without the term that it may stand for.
    families : sequence of Family
        Families that the residual could show.
    base : ndarray, shape (n, p)
        Columns of the baseline.

    Returns
    -------
    BentArm or None
        None where the readings cannot show it, where its cube would be positive, or where one of
        its parts is in the fit.
    """
    cells = (family.cells[0].term for family in families if family.name in _BENT)
    simple = {term.cause.name: term for term in cells if len(term.cause.linear) == 1}
    held = {term.cause.name for term in less.terms}
    if any(name not in simple or name in held for name in _BENT):
        return None
    terms = tuple(simple[name] for name in _BENT)
    trial = fit_loads(less.table, base, (*less.terms, *terms))
    if not trial.linear[-1][0] < 0.0:
        return None
    score = score_nats(less, trial, less.dof - trial.dof) + _UNPAID_NATS
    return BentArm(trial.terms[-2:], score)
