"""Two names together: what neither explains alone may be the sum of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from hdbench.diagnosis.detect.looks import Look
from hdbench.diagnosis.fit.axes import axes_of
from hdbench.diagnosis.fit.families import is_line, is_step
from hdbench.diagnosis.fit.terms import Term, fresh_columns
from hdbench.diagnosis.fit.wholeshare import one_by_definition
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.evidence import score
from hdbench.diagnosis.naming.nameless import unnamed
from hdbench.diagnosis.noise.whitened import Space

__all__ = ["Pair", "best_pairs", "takes_part"]

# share of a column that must be left beside the other one's, as beside what is explained
_LEFT = 0.01


@dataclass(frozen=True, slots=True)
class Pair:
    """Two terms and what they explain together.

    Parameters
    ----------
    terms : tuple of Term
        The one that would be missed more comes first.
    score_nats : float
        Their score, less `trials_nats`.
    trials_nats : float
        Logarithm of the pairs that were tried.
    statistic : float
        What both explain together, at the shapes that each has.
    """

    terms: tuple[Term, Term]
    score_nats: float
    trials_nats: float
    statistic: float


def best_pairs(
    space: Space, record: Record, looks: Sequence[Look], axes: frozenset[str] | None = None
) -> list[Pair]:
    """Return pairs of families by what they explain of a residual together.

    Parameters
    ----------
    space : Space
        Whitened residual.
    record : Record
        Record.
    looks : sequence of Look
        Looks; those of families whose size is free take part, each at its best shape.
    axes : frozenset of str or None
        Axes of which one of the two at least goes along; any where None.

    Returns
    -------
    list of Pair
        Best score first; none of which one could not be told from the other.
    """
    able = [look for look in looks if look.terms and takes_part(look.terms[0])]
    if len(able) < 2:
        return []
    ends = np.cumsum([0, *(len(look.terms[0].cause.linear) for look in able)])
    # all of them stand in memory once
    white = np.empty((len(space.residual), int(ends[-1])), order="F")
    for look, (start, stop) in zip(able, pairwise(ends.tolist()), strict=True):
        white[:, start:stop] = space.project(fresh_columns(look.terms[0], record))
    gram, right = white.T @ white, white.T @ space.residual
    places = [np.arange(a, b) for a, b in pairwise(ends.tolist())]
    tried = float(np.log(len(able) * (len(able) - 1) / 2.0))
    found = []
    for one, two in combinations(range(len(able)), 2):
        if axes is not None and not any(axes_of(able[k].terms[0]) & axes for k in (one, two)):
            continue
        solved = _together(gram, right, places[one], places[two], (able[one], able[two]))
        if solved is not None:
            pair = (able[one].terms[0], able[two].terms[0])
            first = pair if solved[1] else (pair[1], pair[0])
            found.append(Pair(first, solved[0] - tried, tried, solved[2]))
    return sorted(found, key=lambda pair: pair.score_nats, reverse=True)


def takes_part(term: Term) -> bool:
    """Return whether a term is a family of free size: lines are found whatever is beside them.

    Parameters
    ----------
    term : Term
        Term.

    Returns
    -------
    bool
    """
    cause = term.cause
    placed = is_line(cause) or is_step(cause) or unnamed(term)
    return not (placed or one_by_definition(cause))


def _together(
    gram: np.ndarray, right: np.ndarray, one: np.ndarray, two: np.ndarray, looks: tuple[Look, Look]
) -> tuple[float, bool, float] | None:
    """Return what two blocks of columns score, and explain, and which would be missed more.

    The score, whether the first one would be missed more, and the statistic.
    """
    both = np.concatenate([one, two])
    size = np.sqrt(np.diag(gram)[both])
    if not np.all(size > 0.0):
        return None
    scaled = gram[np.ix_(both, both)] / np.outer(size, size)
    if not np.linalg.eigvalsh(scaled)[0] > _LEFT:
        return None
    linear = np.linalg.solve(scaled, right[both] / size) / size
    parts = (linear[: len(one)], linear[len(one) :])
    for look, values in zip(looks, parts, strict=True):
        pairs = zip(look.terms[0].cause.linear, values, strict=True)
        if not all(parameter.contains(float(value)) for parameter, value in pairs):
            return None
    statistic = float(linear @ right[both])
    alone = [
        float(right[k] @ np.linalg.lstsq(gram[np.ix_(k, k)], right[k], rcond=None)[0])
        for k in (one, two)
    ]
    trials = looks[0].trials * looks[1].trials
    return score(statistic, len(both), trials), alone[0] >= alone[1], statistic
