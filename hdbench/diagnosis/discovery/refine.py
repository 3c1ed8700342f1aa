"""Refinement of a candidate's shape beside a fit, and the evidence for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import chain, combinations

import numpy as np

from hdbench.diagnosis.discovery.dictionary import explained, own_directions
from hdbench.diagnosis.discovery.fit import Beside, Fit, Products, scaled_rows, term_rows
from hdbench.diagnosis.discovery.loudness import loudness_beside
from hdbench.diagnosis.discovery.moments import solve_best
from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.spectrum import Shapes
from hdbench.diagnosis.discovery.tables import is_table, subsets_of
from hdbench.diagnosis.discovery.term import (
    WIDE,
    Term,
    follows_motion,
    free_shapes,
    harmonics,
    is_line,
    is_whole_share,
    moved_term,
    smooth_shapes,
    tangent_columns,
)
from hdbench.diagnosis.evidence import PASSED
from hdbench.model import shape_bounds
from hdbench.records.trace import FloatArray

# rounds of Gauss-Newton, steps back in each, and the gain that ends them: a hundredth of a nat
_ROUNDS, _SHORTER, _SETTLED = 6, 3, 0.02
# relative width to which a shape is found that alone gives the size of the effect: Gauss-Newton
# goes on from there
_SIZED = 0.05
# impacts and poles have a harmonic of at least this share of the first
_HARMONIC_SHARE = 0.2
# amplitudes of a weak effect are expected within seven standard deviations: e^4 = 7.4^2
_LEAST_WIDTH = float(np.exp(4.0))
# a table has no name: any name goes before it where it explains as much, at odds of 150 to 1
_TABLE_PRICE = 5.0
# nearly every drive has dry and viscous friction: 150 to 1 against a name that says as much
_COMMON = 5.0
# an order that is not whole is no lobe, tooth or pole: 20 to 1
_NOT_WHOLE_PRICE = 3.0


@dataclass(frozen=True, slots=True)
class Candidate:
    """A term at its best shape beside a fit.

    Parameters
    ----------
    term : Term
        Cause with its shape.
    rows : ndarray, shape (k, size)
        Its rows.
    scale : ndarray, shape (k,)
        Root mean square of its columns.
    statistic : float
        Fall of the weighted sum of squares, in the fit's noise.
    dof : int
        Directions that it has.
    linear : ndarray, shape (k,)
        Its linear parameters.
    trials : float
        Independent places that were tried.
    false_alarm : float
        Probability of such a look without an effect.
    gain_nats : float
        Log likelihood that all its rows gain with coefficients and noise fitted anew.
    evidence_nats : float
        What the rows that speak for its name gain, less the price of parameters, shape and place.
    joined : Fit or None
        The whole fit with it and its form error, where that was made.
    loud : float
        How many times the variance of its amplitude is what the spectrum of the noise says; the
        gain was divided by it.
    """

    term: Term
    rows: FloatArray
    scale: FloatArray
    statistic: float
    dof: int
    linear: FloatArray
    trials: float
    false_alarm: float
    gain_nats: float = 0.0
    evidence_nats: float = -np.inf
    joined: Fit | None = None
    loud: float = 1.0

    @property
    def plain_nats(self) -> float:
        """Evidence by the spectrum of the noise alone, by which names are ranked."""
        return self.evidence_nats + (self.loud - 1.0) * self.gain_nats

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.term.name


def candidate_of(
    beside: Beside, record: Record, term: Term, trials: float, false_alarm: float
) -> Candidate:
    """Return a term as it is beside a fit."""
    rows, scale = term_rows(term, record, beside.bands)
    if float(np.sum(rows**2, axis=1).max()) < PASSED * len(record):
        # of what the channel holds back its ends alone are seen
        none = np.zeros(len(rows))
        return Candidate(term, rows, scale, 0.0, 0, none, trials, false_alarm)
    matrix, right, before = beside.projected(beside.products(rows))
    if is_whole_share(term.cause):
        value = float(scale[0])
        gain = 2.0 * value * float(right[0]) - value**2 * float(matrix[0, 0])
        return Candidate(term, rows, scale, max(gain, 0.0), 1, np.ones(1), trials, false_alarm)
    statistic, dof = explained(matrix, right, before)
    amount = np.linalg.lstsq(matrix, right, rcond=1e-9)[0]
    linear = amount / scale
    parts = harmonics(term.cause) if is_line(term.cause) else []
    if len(parts) > 1 and _nearly_a_sine(linear, parts):
        # repeated impacts and poles have harmonics: what is nearly a sine is one line
        first = parts[0]
        return replace(
            candidate_of_rows(beside, term, rows[first], scale[first], trials, false_alarm),
            rows=rows,
            scale=scale,
            linear=linear,
        )
    if not all(p.contains(float(x)) for p, x in zip(term.cause.linear, linear, strict=True)):
        statistic = 0.0
    if statistic > 0.0 and term.cause.possible is not None:
        directions = scale[:, None] * term.cause.possible(record.motion, term.shape)
        amount, statistic = _within(directions, matrix, right)
        linear = amount / scale
    return Candidate(term, rows, scale, statistic, dof, linear, trials, false_alarm)


def candidate_of_rows(
    beside: Beside, term: Term, rows: FloatArray, scale: FloatArray, trials: float, chance: float
) -> Candidate:
    """Return a term of which only some rows speak for its name."""
    matrix, right, before = beside.projected(beside.products(rows))
    statistic, dof = explained(matrix, right, before)
    linear = np.linalg.lstsq(matrix, right, rcond=1e-9)[0] / scale
    return Candidate(term, rows, scale, statistic, dof, linear, trials, chance)


def _nearly_a_sine(linear: FloatArray, parts: list[list[int]]) -> bool:
    """Return whether no harmonic of a line stands out beside the first."""
    amplitudes = np.array([np.linalg.norm(linear[part]) for part in parts])
    return bool(np.all(amplitudes[1:] <= _HARMONIC_SHARE * amplitudes[0]))


def _is_sine(found: Candidate, parts: list[list[int]]) -> bool:
    """Return whether only the first harmonic of a line speaks for its name."""
    return is_line(found.term.cause) and len(parts) > 1 and found.dof <= len(parts[0])


def _within(
    directions: FloatArray, matrix: FloatArray, right: FloatArray
) -> tuple[FloatArray, float]:
    """Return the best amounts that can be, sums of directions of one sign, and what they explain.

    What noise or another cause moves beyond them is held at their edge.
    """
    from scipy.optimize import nnls

    inner, along = directions.T @ matrix @ directions, directions.T @ right
    value, vector = np.linalg.eigh(inner)
    kept = value > 1e-12 * max(float(value[-1]), 1e-300)
    root = (vector[:, kept] * np.sqrt(value[kept])).T
    best, most = np.zeros(len(directions)), 0.0
    for sign in (1.0, -1.0):
        weights = sign * nnls(root, sign * (vector[:, kept].T @ along) / np.sqrt(value[kept]))[0]
        gain = float(2.0 * weights @ along - weights @ inner @ weights)
        if gain > most:
            best, most = directions @ weights, gain
    return best, most


def refined(beside: Beside, record: Record, start: Candidate) -> Candidate:
    """Return a candidate with its shape at the nearest maximum of the likelihood."""
    best = start
    names = free_shapes(best.term)
    if not names:
        return best
    if is_whole_share(best.term.cause) and best.statistic <= 0.0:
        best = of_right_size(beside, record, best)
    for _ in range(_ROUNDS):
        slopes = tangent_columns(best.term, best.linear, record)
        rows, scale = scaled_rows(beside.bands, slopes)
        free = not is_whole_share(best.term.cause)
        joint = np.concatenate([best.rows, rows]) if free else rows
        matrix, right = beside.project(joint)
        if not free:
            right = right - (
                beside.project(np.concatenate([best.rows, rows]))[0][1:, :1] @ best.scale
            )
        solution = np.linalg.lstsq(matrix + 1e-9 * np.diag(np.diag(matrix)), right, rcond=1e-10)[0]
        moves = solution[-len(names) :] / scale
        ahead = _along(beside, record, best, dict(zip(names, moves.tolist(), strict=True)))
        if ahead is None:
            break
        done = ahead.statistic - best.statistic < _SETTLED
        best = ahead
        if done:
            break
    return best


def of_right_size(beside: Beside, record: Record, start: Candidate) -> Candidate:
    """Return a candidate whose shape alone gives its size, at the best value of that shape."""
    from scipy.optimize import minimize_scalar

    term, name = start.term, smooth_shapes(start.term)[0]
    bands = shape_bounds(term.cause, record.motion)[name]
    if not bands:
        return start
    low, high = bands[0]

    def at(logarithm: float) -> Candidate:
        moved = replace(term, shape={**term.shape, name: float(np.exp(logarithm))})
        return candidate_of(beside, record, moved, start.trials, start.false_alarm)

    best = minimize_scalar(
        lambda x: -at(x).statistic,
        bounds=(np.log(low), np.log(high)),
        method="bounded",
        options={"xatol": _SIZED},
    )
    return max((start, at(float(best.x))), key=lambda c: c.statistic)


def _along(
    beside: Beside, record: Record, best: Candidate, moves: dict[str, float]
) -> Candidate | None:
    """Return the first candidate along a step that explains more."""
    length = 1.0
    for _ in range(_SHORTER):
        moved = moved_term(best.term, {n: length * m for n, m in moves.items()}, record)
        if moved.shape == best.term.shape:
            return None
        ahead = candidate_of(beside, record, moved, best.trials, best.false_alarm)
        if ahead.statistic > best.statistic:
            return ahead
        length *= 0.3
    return None


def weighed(
    beside: Beside, record: Record, found: Candidate, shapes: Shapes, base: float
) -> Candidate:
    """Return a candidate with its evidence: the noise is fitted again with it."""
    if found.statistic <= 0.0 and not is_whole_share(found.term.cause):
        return replace(found, gain_nats=0.0, evidence_nats=-np.inf)
    products = beside.products(found.rows)
    if is_whole_share(found.term.cause):
        gain = speaks = _gain_of_torque(beside, found.scale @ found.rows, shapes, base)
    else:
        moving = follows_motion(found.term.cause)
        gain = speaks = gain_of(beside, products, shapes, base, moving)
        parts = harmonics(found.term.cause)
        if _is_sine(found, parts):
            first = products.mixed(np.eye(len(found.rows))[:, parts[0]])
            speaks = gain_of(beside, first, shapes, base, moving)
    loud = loudness_beside(beside, found.rows, products, found.linear * found.scale)
    statistic = 2.0 * max(speaks, 0.0) / loud
    evidence = amplitude_evidence(beside, found, products, statistic)
    evidence -= price(beside, record, found)
    return replace(found, gain_nats=gain / loud, evidence_nats=evidence, loud=loud)


def gain_of(
    beside: Beside, products: Products, shapes: Shapes, base: float, moving: bool = False
) -> float:
    """Return the log likelihood that rows gain with coefficients and noise fitted anew, nats."""
    matrix, _, before = beside.projected(products)
    own, dof = own_directions(matrix, before)
    if not dof:
        return 0.0
    if dof < len(own):
        products = products.mixed(own)
    cross = products.cross[:, :, beside.kept]
    moments = beside.moments.enlarged(cross, products.own, products.right, moving)
    return solve_best(moments, shapes, beside.spectrum).likelihood - base


def _gain_of_torque(beside: Beside, torque: FloatArray, shapes: Shapes, base: float) -> float:
    """Return the log likelihood that a torque without free amplitude gains, nats."""
    left = beside.residual - torque
    moved = beside.bands.gram(torque[None, :], beside.rows)[:, 0, beside.kept]
    moments = beside.moments
    moments = replace(moments, right=moments.right - moved, power=beside.bands.power(left))
    return solve_best(moments, shapes, beside.spectrum).likelihood - base


def log_evidence(statistic: float, dof: int) -> float:
    """Return the log evidence of linear parameters whose prior is as wide as they are found.

    ``T/2 g/(1+g) - k/2 ln(1+g)``, g the larger of e^4 and T/k - 1.
    """
    if dof == 0:
        return -np.inf
    g = max(_LEAST_WIDTH, statistic / dof - 1.0)
    return 0.5 * statistic * g / (1.0 + g) - 0.5 * dof * float(np.log1p(g))


def amplitude_evidence(
    beside: Beside, found: Candidate, products: Products, statistic: float
) -> float:
    """Return the evidence of the amplitudes; of harmonics any subset is as likely as any other."""
    parts = harmonics(found.term.cause)
    if is_whole_share(found.term.cause):
        return 0.5 * statistic
    if is_table(found.term.cause) and found.statistic > 0.0:
        return _table_evidence(beside, found, products, statistic)
    sine = _is_sine(found, parts)
    if len(parts) < 2 or found.statistic <= 0.0 or sine:
        return log_evidence(statistic, found.dof) - (
            float(np.log(2 ** (len(parts) - 1))) if sine else 0.0
        )
    matrix, right, _ = beside.projected(products)
    ratio = statistic / found.statistic
    scores = []
    for some in chain.from_iterable(combinations(parts, n + 1) for n in range(len(parts))):
        if is_line(found.term.cause) and some[0] is not parts[0]:
            continue
        own = list(chain.from_iterable(some))
        solution = np.linalg.lstsq(matrix[np.ix_(own, own)], right[own], rcond=1e-9)[0]
        scores.append(log_evidence(ratio * float(solution @ right[own]), len(own)))
    return float(np.logaddexp.reduce(scores)) - float(np.log(len(scores)))


def _table_evidence(
    beside: Beside, found: Candidate, products: Products, statistic: float
) -> float:
    """Return the evidence of a table: any simpler function that it holds is as likely as all."""
    matrix, right, before = beside.projected(products)
    ratio = statistic / found.statistic
    scores = [log_evidence(statistic, found.dof)]
    for subset in subsets_of(found.term.cause):
        mix = found.scale[:, None] * subset
        some, dof = explained(mix.T @ matrix @ mix, mix.T @ right, before @ mix**2)
        scores.append(log_evidence(ratio * some, dof))
    return float(np.logaddexp.reduce(scores)) - float(np.log(len(scores)))


def price(beside: Beside, record: Record, found: Candidate) -> float:
    """Return what shape and place of a candidate cost, nats; a common cause costs less."""
    return _place_price(beside, record, found) - (_COMMON if found.term.cause.common else 0.0)


def _place_price(beside: Beside, record: Record, found: Candidate) -> float:
    term = found.term
    if is_table(term.cause):
        return _TABLE_PRICE + float(np.log(max(found.trials, 1.0)))
    if is_line(term.cause) or "step_time_s" in term.shape:
        extra = 0.0
        if "order" in term.shape and term.shape["order"] % 1.0 != 0.0:
            extra = _NOT_WHOLE_PRICE
        return float(np.log(max(found.trials, 1.0))) + extra
    names = smooth_shapes(term)
    if not names:
        return 0.0
    slopes = tangent_columns(term, found.linear, record) * _domains(record, term)
    information = _beside_own(beside, found, beside.bands.transform(slopes))
    values = np.linalg.eigvalsh(information) / (2.0 * np.pi)
    laplace = 0.5 * float(np.sum(np.log(np.maximum(values, 1.0))))
    return max(laplace, float(np.log(max(found.trials, 1.0))))


def _beside_own(beside: Beside, found: Candidate, rows: FloatArray) -> FloatArray:
    """Return the information of rows beside the fit and the candidate's own amplitudes."""
    matrix, _ = beside.project(np.concatenate([found.rows, rows]))
    k = len(found.rows)
    own, cross, rest = matrix[:k, :k], matrix[:k, k:], matrix[k:, k:]
    return np.asarray(rest - cross.T @ np.linalg.lstsq(own, cross, rcond=1e-9)[0])


def _domains(record: Record, term: Term) -> FloatArray:
    """Return the width of each shape's domain, in the shape's own unit about its value."""
    bounds = shape_bounds(term.cause, record.motion)
    widths = []
    for name in smooth_shapes(term):
        bands = bounds[name]
        low = min((a for a, _ in bands), default=0.0)
        high = max((b for _, b in bands), default=0.0)
        wide = low > 0.0 and high > WIDE * low
        widths.append(abs(term.shape[name]) * np.log(high / low) if wide else high - low)
    return np.array(widths)
