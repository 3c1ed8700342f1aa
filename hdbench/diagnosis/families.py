"""The catalogue's families that are no line of a scan, tested over a grid of their shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.special import gammaincc

from hdbench.diagnosis.record import Record
from hdbench.diagnosis.terms import Term, term_columns
from hdbench.diagnosis.whitened import Space
from hdbench.model import Cause, Parameter, shape_bounds
from hdbench.records.trace import FloatArray

__all__ = [
    "FamilyHit",
    "exact_statistic",
    "family_causes",
    "is_line",
    "scan_family",
    "shape_grid",
    "sharpen_step",
]

# share of a column that must be left after the explained part was projected out
_MIN_SHARE = 0.01
# whitened size squared of a column of which 1000 N m are one standard deviation
_FAINTEST = 1e-6
# grid points of a shape parameter, of a step in time, and of all of a family's together
_POINTS = 8
_STEP_POINTS = 48
_MAX_POINTS = 48
# places tried in each round of the search for a step, and rounds: 0.4 s shrink below 1 ms
_STEP_TRIALS = 15
_STEP_ROUNDS = 4
# a domain wider than this ratio is gridded by equal ratios
_WIDE = 10.0


@dataclass(frozen=True, slots=True)
class FamilyHit:
    """The best member of a family on a grid of shapes.

    Parameters
    ----------
    term : Term
        Cause with the best shape.
    statistic : float
        chi^2 with `dof` degrees of freedom without the cause, for one grid point.
    dof : int
        Linear parameters that the record can tell from what is explained.
    trials : int
        Grid points tried.
    p_value : float
        Probability of the statistic or more over all trials, without the cause.
    sigma_nm : float
        Standard deviation of the cause's largest torque, N m.
    """

    term: Term
    statistic: float
    dof: int
    trials: int
    p_value: float
    sigma_nm: float


def is_line(cause: Cause) -> bool:
    """Return whether a cause is found by a scan: it has an order or a frequency.

    Parameters
    ----------
    cause : Cause
        Cause.

    Returns
    -------
    bool
    """
    return any(p.name in ("order", "frequency_hz") for p in cause.shape)


def family_causes(record: Record, causes: tuple[Cause, ...]) -> tuple[Cause, ...]:
    """Return the causes to be tested as families on this record.

    Parameters
    ----------
    record : Record
        Record; its motion says what it can show.
    causes : tuple of Cause
        Catalogue.

    Returns
    -------
    tuple of Cause
        Those without order or frequency that the motion allows.
    """
    return tuple(c for c in causes if not is_line(c) and c.applicable(record.motion) is None)


def _grid(parameter: Parameter, bands: tuple[tuple[float, float], ...]) -> FloatArray:
    points = []
    for low, high in bands:
        if parameter.name == "step_time_s":
            points.append(np.linspace(low, high, _STEP_POINTS + 2)[1:-1])
        elif low > 0.0 and high > _WIDE * low:
            points.append(np.geomspace(low, high, _POINTS))
        else:
            points.append(np.linspace(low, high, _POINTS))
    return np.concatenate(points) if points else np.zeros(0)


def shape_grid(cause: Cause, record: Record) -> list[Mapping[str, float]]:
    """Return the shapes at which a family is tested, at most 48.

    Parameters
    ----------
    cause : Cause
        Cause.
    record : Record
        Record; cuts the domain to what it can show.

    Returns
    -------
    list of mapping
        One empty mapping for a cause without shape parameters.
    """
    bounds = shape_bounds(cause, record.motion)
    axes = [_grid(p, bounds[p.name]) for p in cause.shape]
    while int(np.prod([len(a) for a in axes], initial=1)) > _MAX_POINTS:
        longest = max(range(len(axes)), key=lambda i: len(axes[i]))
        axes[longest] = axes[longest][::2]
    names = [p.name for p in cause.shape]
    return [dict(zip(names, map(float, point), strict=True)) for point in product(*axes)]


def exact_statistic(space: Space, columns: FloatArray) -> tuple[float, int, FloatArray]:
    """Return the statistic of columns in a space, its dof and the linear parameters.

    Parameters
    ----------
    space : Space
        Whitened residual.
    columns : ndarray, shape (n, k)
        Columns, N m per unit.

    Returns
    -------
    statistic : float
        ``v' (X' M X)^+ v``.
    dof : int
        Rank of what is left of the columns.
    linear : ndarray, shape (k,)
        Linear parameters.
    """
    left = space.project(columns)
    white_size = np.einsum("nk,nk->k", left, left)
    before = white_size + np.sum((space.pull_basis.T @ columns) ** 2, axis=0)
    # an effect of 1000 N m, the most that the catalogue allows, would stay below the noise
    if not np.all(before > _FAINTEST):
        return 0.0, 0, np.zeros(columns.shape[1])
    scale = 1.0 / np.sqrt(before)
    gram = (left.T @ left) * np.outer(scale, scale)
    values, vectors = np.linalg.eigh(gram)
    good = values > _MIN_SHARE
    right = vectors[:, good].T @ (scale * (left.T @ space.residual))
    linear = scale * (vectors[:, good] @ (right / values[good]))
    return float(np.sum(right**2 / values[good])), int(good.sum()), linear


def sharpen_step(space: Space, record: Record, term: Term) -> Term:
    """Return a step in time moved to the sample where it fits best.

    Parameters
    ----------
    space : Space
        Whitened residual without the term.
    record : Record
        Record.
    term : Term
        Any term; one without a step is returned as it is.

    Returns
    -------
    Term
        Searched around its place on the grid of shapes, in four rounds that shrink sevenfold: a
        shape that jumps has no slope to follow.
    """
    if "step_time_s" not in term.shape:
        return term
    reach = float(np.ptp(record.motion.time_s)) / _STEP_POINTS
    for _ in range(_STEP_ROUNDS):
        centre = term.shape["step_time_s"]
        tried = [
            replace(term, shape={**term.shape, "step_time_s": float(place)})
            for place in np.linspace(centre - reach, centre + reach, _STEP_TRIALS)
        ]
        values = [exact_statistic(space, term_columns(t, record))[0] for t in tried]
        term = tried[int(np.argmax(values))]
        reach *= 2.0 / (_STEP_TRIALS - 1)
    return term


def scan_family(space: Space, record: Record, cause: Cause) -> FamilyHit | None:
    """Return the best member of a family, None where the record shows nothing of it.

    Parameters
    ----------
    space : Space
        Whitened residual.
    record : Record
        Record.
    cause : Cause
        Cause that is no line.

    Returns
    -------
    FamilyHit or None
    """
    best: tuple[float, float, int, Term, FloatArray] | None = None
    trials = 0
    for shape in shape_grid(cause, record):
        term = Term(cause, shape)
        columns = term_columns(term, record)
        if not np.isfinite(columns).all():
            return None
        statistic, dof, linear = exact_statistic(space, columns)
        if dof == 0:
            continue
        trials += 1
        p = float(gammaincc(dof / 2.0, statistic / 2.0))
        if best is None or (p, -statistic) < (best[0], -best[1]):
            best = (p, statistic, dof, term, np.abs(columns @ linear))
    if best is None:
        return None
    p, statistic, dof, term, torque = best
    size = float(torque.max())
    sigma = size / float(np.sqrt(statistic)) if statistic > 0.0 else float("inf")
    return FamilyHit(term, statistic, dof, trials, min(1.0, trials * p), sigma)
