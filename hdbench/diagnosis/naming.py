"""From a place on a scan, or a family, to candidates with names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.jointfit import JointFit, fit_jointly
from hdbench.diagnosis.record import Record
from hdbench.diagnosis.terms import Term, term_columns
from hdbench.diagnosis.whitened import Space, Whitener
from hdbench.model import Cause, Motion, Parameter
from hdbench.records.trace import FloatArray

__all__ = [
    "Candidate",
    "line_terms",
    "output_line",
    "refine_candidate",
    "same_space",
    "slow_tone",
    "unnamed",
]

# contract: names whose effect spans the same space on this record
_SAME_SPACE = 0.01
# an order is an integer where it lies within this many standard deviations of one ...
_INTEGER_SIGMA = 3.0
# ... and is known to this: a tenth of the distance to the next half
_INTEGER_STD = 0.05
_RANK = 1e-9


@dataclass(frozen=True, slots=True)
class Candidate:
    """A term that may be accepted, refined together with all that was accepted before.

    Parameters
    ----------
    term : Term
        Refined term.
    fit : JointFit
        The joint fit with it.
    statistic : float
        Fall of the whitened sum of squares that it brings.
    parameters : int
        Linear and shape parameters that its score pays for.
    score_nats : float
        ``statistic / 2 - parameters / 2 ln n``.
    """

    term: Term
    fit: JointFit
    statistic: float
    parameters: int
    score_nats: float


def _line_columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    angle = shape["order"] * motion.output_angle_rad
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _tone_columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    angle = 2.0 * np.pi * shape["frequency_hz"] * motion.time_s
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _nameless(
    name: str, shape: Parameter, locked_to: str, lines: Callable[..., FloatArray]
) -> Cause:
    pair = tuple(
        Parameter(part, "N m", -np.inf, np.inf, "quadrature") for part in ("cosine_nm", "sine_nm")
    )
    return Cause(
        name,
        "A cos(x + phase)",
        (shape,),
        pair,
        locked_to,
        "",
        "",
        (),
        "",
        "",
        lines,
        True,
    )


def output_line() -> Cause:
    """Return a line at any output order: no name of the catalogue has it.

    Returns
    -------
    Cause
        One shape parameter ``order``, cycles per output turn, and two quadratures, N m.
    """
    shape = Parameter("order", "1", 0.1, 1e4, "cycles per output turn")
    return _nameless("output-order line", shape, "output", _line_columns)


def slow_tone() -> Cause:
    """Return a tone below the catalogue's tones.

    Returns
    -------
    Cause
        One shape parameter ``frequency_hz``, Hz, and two quadratures, N m.
    """
    shape = Parameter("frequency_hz", "Hz", 0.0, 1e5, "frequency")
    return _nameless("tone", shape, "clock", _tone_columns)


def unnamed(term: Term) -> bool:
    """Return whether a term is a line without a name.

    Parameters
    ----------
    term : Term
        Term.

    Returns
    -------
    bool
    """
    return term.cause.name in ("output-order line", "tone")


def line_terms(
    domain: str, place: float, causes: tuple[Cause, ...], motion: Motion, cell: float
) -> list[Term]:
    """Return the terms that a line at a place may be.

    Parameters
    ----------
    domain : str
        ``motor-order``, ``output-order`` or ``frequency``.
    place : float
        Order or frequency, Hz.
    causes : tuple of Cause
        Catalogue.
    motion : Motion
        Motion of the record.
    cell : float
        Resolution of the axis, its own unit.

    Returns
    -------
    list of Term
        Every cause of the catalogue that has this place in its domain; a nameless line where
        there is none, and for every output order. Within a resolution cell of output order 2 the
        angular misalignment is tried too, on less than a whole output turn as well.
    """
    if domain == "output-order":
        twice = [Term(c, {}) for c in causes if c.name == "angular-misalignment"]
        line = Term(output_line(), {"order": place})
        return [line, *twice] if abs(place - 2.0) <= cell else [line]
    key = "order" if domain == "motor-order" else "frequency_hz"
    terms = [
        Term(cause, {key: place})
        for cause in causes
        if [p.name for p in cause.shape] == [key]
        and cause.shape[0].contains(place)
        and cause.applicable(motion) is None
    ]
    if not terms and domain == "frequency":
        terms = [Term(slow_tone(), {key: place})]
    return terms


def _paid_shapes(term: Term, covariance: FloatArray) -> int:
    """Return how many shape parameters a score pays for: an integer order costs nothing."""
    names = [p.name for p in term.cause.shape]
    if names != ["order"]:
        return len(names)
    value, std = term.shape["order"], float(np.sqrt(covariance[-1, -1]))
    near = abs(value - round(value)) <= _INTEGER_SIGMA * std
    return 0 if near and std <= _INTEGER_STD else 1


def refine_candidate(record: Record, base: JointFit, term: Term, whitener: Whitener) -> Candidate:
    """Fit a term together with all accepted ones and score it.

    Parameters
    ----------
    record : Record
        Record.
    base : JointFit
        Fit without the term, in the same noise.
    term : Term
        Term with a starting shape.
    whitener : Whitener
        Noise.

    Returns
    -------
    Candidate
    """
    fit = fit_jointly(record, (*base.terms, term), whitener)
    refined = fit.terms[-1]
    statistic = base.chi2 - fit.chi2
    paid = _paid_shapes(refined, fit.covariances[-1])
    if paid < len(refined.cause.shape):
        whole = Term(refined.cause, {"order": float(round(refined.shape["order"]))})
        held = fit_jointly(record, (*base.terms, whole), whitener, refine=False)
        statistic = base.chi2 - held.chi2
    count = len(refined.cause.linear) + paid
    n_used = float(whitener.used.sum())
    score = 0.5 * statistic - 0.5 * count * float(np.log(n_used))
    return Candidate(refined, fit, statistic, count, score)


def same_space(space: Space, record: Record, first: Term, second: Term) -> bool:
    """Return whether two terms span the same space on this record.

    Parameters
    ----------
    space : Space
        Whitened space with what both have in common to explain projected out.
    record : Record
        Record.
    first, second : Term
        Terms.

    Returns
    -------
    bool
        True where both have as many directions and the sine squared of the largest angle
        between them is below 0.01.
    """
    bases = []
    for term in (first, second):
        left = space.project(term_columns(term, record))
        values, vectors = np.linalg.eigh(left.T @ left)
        good = values > _RANK * max(float(values[-1]), 1e-300)
        bases.append(left @ (vectors[:, good] / np.sqrt(values[good])))
    if bases[0].shape[1] != bases[1].shape[1]:
        return False
    cosines = np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)
    return bool(1.0 - float(cosines.min()) ** 2 < _SAME_SPACE)
