"""Whether a second name is no more than what the form of the first one leaves."""

from __future__ import annotations

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads
from hdbench.diagnosis.loads.names import without
from hdbench.diagnosis.loads.pace import MEMORY, memory_share
from hdbench.records.trace import FloatArray

__all__ = ["is_misfit"]

# the form of a cause is never quite that of the catalogue: what comes second must be worth more
# than a misfit of the first is, a Bayes factor of 20 000 and this share of what is explained
_SECOND_NATS = 10.0
_SECOND_SHARE = 0.003
# along the axis of one that is accepted already a misfit is larger: by another law of hysteresis (a
# loop of Bouc and Wen from rest) the catalogue's leaves 2 % of the sum of squares
_SAME_AXIS_SHARE = 0.03
_AXES = (
    ("hysteresis", "creep", "cubic-nonlinearity", "saturation", "arm-sag", "backlash"),
    ("zero-drift", "warm-up"),
)


def is_misfit(term: Term, more: LoadFit, score_nats: float, fit: LoadFit, base: FloatArray) -> bool:
    """Return whether a further term is no more than a misfit of those that are accepted.

    Parameters
    ----------
    term : Term
        Further term.
    more : LoadFit
        Fit with it.
    score_nats : float
        Its score.
    fit : LoadFit
        Fit without it.
    base : ndarray, shape (n, p)
        Columns of the baseline.

    Returns
    -------
    bool
    """
    if not fit.terms:
        return False
    drop = fit.rss - more.rss
    plain = fit_loads(fit.table, base, ())
    small = drop < _SECOND_SHARE * (plain.rss - fit.rss)
    axis = next((a for a in _AXES if term.cause.name in a), (term.cause.name,))
    for place, other in enumerate(fit.terms):
        if other.cause.name in axis and other.cause.name not in ("outlier", "zero-step"):
            less = fit_loads(fit.table, base, without(fit.terms, place), refine=False)
            memory = {other.cause.name, term.cause.name} == MEMORY
            share = 1.0 - memory_share(fit.table) if memory else _SAME_AXIS_SHARE
            small = small or drop < share * (less.rss - fit.rss)
    return small or score_nats < _SECOND_NATS
