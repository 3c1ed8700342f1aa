"""How much a name explains, less what its freedom would explain by chance: evidence, nats."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, combinations

import numpy as np

from hdbench.diagnosis.detect.exact import solve_exactly
from hdbench.diagnosis.fit.families import Refined, is_line
from hdbench.diagnosis.fit.terms import (
    Term,
    harmonics,
    smooth_shapes,
    tangent_columns,
    term_columns,
)
from hdbench.diagnosis.fit.wholeshare import one_by_definition
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.noise.whitened import Space
from hdbench.model import shape_bounds
from hdbench.records.trace import FloatArray

__all__ = ["evidence", "most_evidence", "score"]

# amplitudes of some seven standard deviations are expected, ln 7^2: fewer would let causes with
# many parameters pass for one with few, more would ask those with many to be huge
_LOG_EFFECTIVE = 4.0
_RANK = 1e-9
# a domain wider than this ratio is even in its logarithm
_WIDE = 10.0


def score(statistic: float, dof: int, trials: float) -> float:
    """Return the score of a candidate, nats.

    Parameters
    ----------
    statistic : float
        Fall of the whitened sum of squares.
    dof : int
        Linear parameters.
    trials : float
        Effective number of shapes that were tried.

    Returns
    -------
    float
        ``statistic / 2 - dof / 2 ln n_eff - ln trials``: log of the evidence against no effect,
        for amplitudes that are expected within some seven standard deviations.
    """
    return 0.5 * statistic - 0.5 * dof * _LOG_EFFECTIVE - float(np.log(max(trials, 1.0)))


def evidence(space: Space, record: Record, found: Refined, trials: float) -> float:
    r"""Return the log of the marginal likelihood of a refined name against no effect, nats.

    Parameters
    ----------
    space : Space
        Whitened residual without the term.
    record : Record
        Record.
    found : Refined
        Term at its best shape.
    trials : float
        Effective number of places that were tried, for lines and steps; else of shapes that the
        residual tells from the best one.

    Returns
    -------
    float

    Notes
    -----
    What parameters explain that go with a cause but are just as well another name's does not count.
    Amplitudes are expected within some seven standard deviations, shapes anywhere in their domain
    (in the logarithm where it spans more than a decade). Near its best shape the likelihood is
    normal, so that with the information F that the record has on shapes in units of their domains

    .. math:: \ln \int e^{L(q)} dq = L(\hat q) - \tfrac12 \sum \max(0, \ln (\lambda_i(F) / 2 \pi))

    (Laplace; a shape that the record says nothing on costs nothing). Far from the best shape the
    likelihood is not normal: no shape costs less than the mean likelihood over the shapes at which
    the family was looked for. Of a cause with several
    harmonics each subset is as likely as any other: the mean of their likelihoods. Harmonics of a
    place that a scan found have the first one among them.
    """
    term = found.term
    parts = harmonics(term.cause)
    places = _at_places(term)
    if places and len(parts) < 2:
        return score(found.statistic, found.dof, trials)
    columns = term_columns(term, record)
    _, _, linear, left = solve_exactly(space, columns)
    if places:
        return _of_harmonics(parts, left, space.residual, True) - float(np.log(max(trials, 1.0)))
    least = np.array([0.0 if p.lower == 0.0 else -np.inf for p in term.cause.linear])
    sized = one_by_definition(term.cause)
    size = np.ones(1) if sized else np.maximum(linear, least)
    slopes = space.project(tangent_columns(term, size, columns, record))
    # the first shape of a limit or a play is its size
    left = slopes[:, :1] if sized else left
    paid = max(_shape_cost(left, slopes * _domains(record, term)), float(np.log(trials)))
    if not all(p.evident for p in term.cause.linear):
        return _of_own(term, left, space.residual) - paid
    if len(parts) < 2:
        return score(found.statistic, found.dof, 1.0) - paid
    return _of_harmonics(parts, left, space.residual, False) - paid


def _of_own(term: Term, left: FloatArray, residual: FloatArray) -> float:
    """Return the evidence of the parameters that speak for the name, beside those that do not."""
    own = np.array([p.evident for p in term.cause.linear])
    other = left[:, ~own]
    beside = left[:, own] - other @ np.linalg.lstsq(other, left[:, own], rcond=_RANK)[0]
    solution = np.linalg.lstsq(beside, residual, rcond=_RANK)[0]
    return score(float(solution @ (beside.T @ residual)), int(own.sum()), 1.0)


def _of_harmonics(
    parts: Sequence[Sequence[int]], left: FloatArray, residual: FloatArray, with_first: bool
) -> float:
    """Return the evidence for any subset of harmonics, nats: each as likely as any other."""
    right = left.T @ residual
    gram = left.T @ left
    scores = []
    for some in chain.from_iterable(combinations(parts, n + 1) for n in range(len(parts))):
        if with_first and some[0] is not parts[0]:
            continue
        own = list(chain.from_iterable(some))
        solution = np.linalg.lstsq(gram[np.ix_(own, own)], right[own], rcond=_RANK)[0]
        scores.append(score(float(solution @ right[own]), len(own), 1.0))
    return float(np.logaddexp.reduce(scores)) - float(np.log(len(scores)))


def most_evidence(term: Term, statistic: float, dof: int, trials: float) -> float:
    """Return the most that `evidence` can give, nats.

    Parameters
    ----------
    term : Term
        Term.
    statistic : float
        Fall of the whitened sum of squares at its best shape.
    dof : int
        Linear parameters.
    trials : float
        As for `evidence`.

    Returns
    -------
    float
    """
    least = min((len(part) for part in harmonics(term.cause)), default=dof)
    return score(statistic, least, trials)


def _at_places(term: Term) -> bool:
    """Return whether the shape of a term is a place that a scan found."""
    return is_line(term.cause) or "step_time_s" in term.shape


def _shape_cost(left: FloatArray, slopes: FloatArray) -> float:
    """Return what the choice of the shape costs, nats: its slopes beside those of the size."""
    slopes = slopes - left @ np.linalg.lstsq(left.T @ left, left.T @ slopes, rcond=_RANK)[0]
    values = np.linalg.eigvalsh(slopes.T @ slopes) / (2.0 * np.pi)
    return 0.5 * float(np.sum(np.log(np.maximum(values, 1.0))))


def _domains(record: Record, term: Term) -> FloatArray:
    """Return the width of each shape's domain, in the shape's own unit about its value."""
    bounds = shape_bounds(term.cause, record.motion)
    widths = []
    for name in smooth_shapes(term):
        bands = bounds[name]
        low = min((a for a, _ in bands), default=0.0)
        high = max((b for _, b in bands), default=0.0)
        wide = low > 0.0 and high > _WIDE * low
        widths.append(abs(term.shape[name]) * np.log(high / low) if wide else high - low)
    return np.array(widths)
