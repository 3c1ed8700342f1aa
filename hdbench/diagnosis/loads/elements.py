"""One cause that takes several elements of its form: a loop that no single one follows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from hdbench.diagnosis.loads.families import Family
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads, score_nats
from hdbench.diagnosis.loads.names import Accepted, accept
from hdbench.diagnosis.loads.shapes import DISCRETE
from hdbench.diagnosis.loads.space import Space
from hdbench.records.trace import FloatArray

__all__ = ["accept_elements", "elements_of"]


def elements_of(fit: LoadFit, n_known: int) -> tuple[tuple[int, ...], ...]:
    """Return which terms of a fit are elements of one cause.

    Parameters
    ----------
    fit : LoadFit
        Final fit.
    n_known : int
        Terms at its beginning that were known.

    Returns
    -------
    tuple of tuple of int
        Indices of the terms of each cause, in the order in which they were found. Two of one name
        are one cause where the shape changes smoothly; two steps, or two readings that stand
        apart, are two.
    """
    parts: dict[object, list[int]] = {}
    for place, term in enumerate(fit.terms[n_known:], n_known):
        smooth = any(p.name not in DISCRETE for p in term.cause.shape)
        parts.setdefault(term.cause.name if smooth else place, []).append(place)
    return tuple(tuple(places) for places in parts.values())


def accept_elements(
    fit: LoadFit,
    places: tuple[int, ...],
    base: FloatArray,
    families: Callable[[LoadFit, Space], Sequence[Family]],
    false_alarm: float,
) -> Accepted:
    """Return a cause of the final fit with the names that it could also have.

    Parameters
    ----------
    fit : LoadFit
        Final fit.
    places : tuple of int
        Indices of its elements.
    base : ndarray, shape (n, p)
        Columns of the baseline.
    families : callable
        ``families(fit, space)`` gives the families that the residual of a fit could show.
    false_alarm : float
        Probability of the finding.

    Returns
    -------
    Accepted
        Of several elements the names are those that the first one alone could have.
    """
    if len(places) == 1:
        return accept(fit, places[0], base, families, false_alarm)
    others = tuple(t for i, t in enumerate(fit.terms) if i not in places)
    less = fit_loads(fit.table, base, others, refine=False)
    alone = fit_loads(fit.table, base, (*others, fit.terms[places[0]]))
    accepted = accept(alone, len(others), base, families, false_alarm)
    evidence = score_nats(less, fit, less.dof - fit.dof)
    return replace(accepted, evidence_nats=evidence, places=places, alone=alone)
