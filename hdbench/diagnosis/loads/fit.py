"""Joint fit of gain, zeros and causes with the form error of the causes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.evidence import marginal_nats, orthonormal
from hdbench.diagnosis.loads.forms import DISCRETE, Term
from hdbench.diagnosis.loads.table import LoadTable
from hdbench.model import Parameter
from hdbench.records.trace import FloatArray

__all__ = ["LoadFit", "Space", "fit_loads"]

# form error, as a share of the effect, of each way in which it may differ from its form: a law of
# a mechanism (a loop, a creep, a limit) is good to a few percent; a polynomial, which is its own
# definition, to the curve of second order that an arm or a weight adds
FORM_ERROR = 0.04
PLAIN_ERROR = 0.003
# part of an effect that may stand at other values of its shape: plays, limits, yields and time
# constants are spread in real parts
SPREAD = 0.2
# polynomials of the load in a form error: as many as a calibration has levels, and more
_CURVES = 6
# readings carry rounding at this share of the largest one
_ROUNDING = 1e-12
# relative change of a shape parameter, or of its domain, by which a slope is formed
_STEP = 1e-4
# refinement ends after this many steps: grids start it within a fifth of where it ends
_CALLS = 30
# a limit acts on the signal before it, which the fit gives: they settle in this many rounds
_ROUNDS = 4
# ... or when nothing moves by more than this share of the largest torque
_SETTLED = 1e-6
# what is left of a column below this share of its size is what the fit has already
_VISIBLE = 1e-5


@dataclass(frozen=True, slots=True)
class Space:
    """What a fit leaves, in coordinates in which noise and form error are white."""

    used: NDArray[np.bool_]  # readings of the fit, shape (n,)
    basis: FloatArray  # from them to these coordinates, shape (n_used, dof)
    residual_v: FloatArray  # shape (dof,)

    @property
    def dof(self) -> int:
        """Degrees of freedom."""
        return int(self.basis.shape[1])

    @property
    def rss(self) -> float:
        """Sum of squares of the residual, V^2."""
        return float(self.residual_v @ self.residual_v)

    def directions(self, columns: FloatArray) -> FloatArray:
        """Return an orthonormal basis of what the fit leaves of columns, shape (dof, rank)."""
        raw = columns[self.used]
        if not np.isfinite(raw).all():
            return np.zeros((self.dof, 0))
        size = np.sqrt(np.einsum("nk,nk->k", raw, raw))
        left = self.basis.T @ (raw[:, size > 0.0] / size[size > 0.0])
        if left.shape[1] == 1:
            length = float(np.linalg.norm(left))
            return np.asarray(left / length if length > _VISIBLE else left[:, :0])
        u, s, _ = np.linalg.svd(left, full_matrices=False)
        return np.asarray(u[:, s > _VISIBLE])

    def share(self, directions: FloatArray) -> float:
        """Return which share of the residual's sum of squares lies along directions."""
        along = directions.T @ self.residual_v
        return float(along @ along) / self.rss if self.rss > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class LoadFit:
    """Result of a joint fit."""

    terms: tuple[Term, ...]
    slope_v_per_nm: float  # one over the gain
    base: FloatArray  # coefficients of the baseline's columns, V per unit
    linear: tuple[FloatArray, ...]  # of each term
    covariances: tuple[FloatArray, ...]  # of these, then free shapes; 0 where not known
    fitted_v: FloatArray
    explained: FloatArray  # columns that span the fit, slopes over shapes too
    forms_v: FloatArray  # form errors, one standard deviation each
    noise_v2: float
    rss: float
    dof: int  # readings less resolved parameters
    nats: float  # evidence
    table: LoadTable  # with the signal of this fit, before any limit

    @property
    def noise_nm(self) -> float:
        """Standard deviation of the noise, N m."""
        return float(np.sqrt(self.noise_v2)) / abs(self.slope_v_per_nm)

    @property
    def plain_nats(self) -> float:
        """Evidence without form error."""
        n = float(self.table.used.sum())
        return -0.5 * n * float(np.log(self.rss)) + 0.5 * self.dof * float(np.log(n))

    def effect_nm(self, place: int) -> FloatArray:
        """Return the torque of a term, shape (n,)."""
        return np.asarray(self.terms[place].columns(self.table) @ self.linear[place])

    def space(self) -> Space:
        """Return what the fit leaves of the readings."""
        used = self.table.used
        white = _Whitener(self.forms_v[used], self.noise_v2)
        known = orthonormal(white(self.explained[used]))
        basis = white(np.linalg.qr(known, mode="complete")[0][:, known.shape[1] :])
        return Space(used, basis, basis.T @ self.table.reading_v[used])


class _Whitener:
    """Symmetric root of the inverse of ``1 + U U^T / s^2``."""

    def __init__(self, forms: FloatArray, variance: float) -> None:
        if forms.shape[1]:
            u, s, _ = np.linalg.svd(forms, full_matrices=False)
        else:
            u, s = forms, np.zeros(0)
        self._u = u
        self._less = 1.0 - 1.0 / np.sqrt(1.0 + s**2 / max(variance, 1e-300))

    def __call__(self, columns: FloatArray) -> FloatArray:
        return np.asarray(columns - (self._u * self._less) @ (self._u.T @ columns))


def _solve(design: FloatArray, response: FloatArray) -> FloatArray:
    """Return the least-squares solution of least norm in scaled columns."""
    size = np.sqrt(np.einsum("nk,nk->k", design, design))
    size = np.where(size > 0.0, size, 1.0)
    return np.asarray(np.linalg.lstsq(design / size, response, rcond=1e-9)[0] / size)


def _design(base: FloatArray, terms: Sequence[Term], table: LoadTable) -> FloatArray:
    """Return all columns; what takes a share of 1 is part of the torque."""
    parts = [base.copy()]
    for term in terms:
        columns = term.columns(table)
        if term.form.whole:
            parts[0][:, 0] += columns[:, 0]
        else:
            parts.append(columns)
    return np.hstack(parts)


def fit_loads(
    table: LoadTable, base: FloatArray, terms: Sequence[Term], *, refine: bool = True
) -> LoadFit:
    """Fit gain, zeros and causes together, shapes too unless `refine` is False.

    Readings on torque, because the weights are known and the readings are noisy; `base` has the
    applied torque first.
    """
    chosen = tuple(terms)
    acts = any(term.form.cause.whole_signal for term in chosen)
    for _ in range(_ROUNDS if acts else 1):
        chosen = _refined(chosen, base, table) if refine else chosen
        fit = _linear_fit(table, base, chosen)
        moved = np.asarray(fit.table.motion.simulated_nm) - np.asarray(table.motion.simulated_nm)
        table = fit.table
        if float(np.abs(moved).max()) <= _SETTLED * table.top_nm:
            break
    return fit


def _linear_fit(table: LoadTable, base: FloatArray, terms: tuple[Term, ...]) -> LoadFit:
    used, response = table.used, table.reading_v[table.used]
    n = len(response)
    floor = (_ROUNDING * float(np.abs(response).max())) ** 2
    design = _design(base, terms, table)
    solution = _solve(design[used], response)
    linear, slope = _parted(solution, base, terms)
    explained, places = _jacobian(base, terms, linear, slope, table)
    basis, first = orthonormal(explained[used]), orthonormal(base[used])
    pairs = zip(terms, linear, strict=True)
    errors = [_form_error(term, a, slope, table, first) for term, a in pairs]
    forms = np.hstack([np.zeros((len(table), 0)), *errors])
    seen = forms[used] - basis @ (basis.T @ forms[used])
    left = response - design[used] @ solution
    dof = n - basis.shape[1]
    nats, variance = marginal_nats(left, seen, n - first.shape[1], floor)
    variance *= (n - first.shape[1]) / max(dof, 1)
    fitted = design @ solution
    left = response - fitted[used]
    added = basis.shape[1] - first.shape[1] + sum(t.form.discrete for t in terms)
    prior = sum(t.form.prior_nats for t in terms)
    return LoadFit(
        terms,
        slope,
        solution[: base.shape[1]],
        linear,
        _covariances(explained[used], forms[used], places, terms, variance),
        fitted,
        explained,
        forms,
        variance,
        max(float(left @ left), n * floor),
        dof,
        nats - 0.5 * added * float(np.log(n)) - prior,
        table.with_signal(fitted / slope - _taken(terms, linear, table)),
    )


def _parted(
    solution: FloatArray, base: FloatArray, terms: Sequence[Term]
) -> tuple[tuple[FloatArray, ...], float]:
    """Return the linear parameters of each term, and the slope."""
    slope = float(solution[0])
    slope = slope if abs(slope) > _ROUNDING else _ROUNDING
    linear, at = [], base.shape[1]
    for term in terms:
        width = 0 if term.form.whole else len(term.form.linear) + len(term.form.beside)
        linear.append(solution[at : at + width] / slope if width else np.ones(1))
        at += width
    return tuple(linear), slope


def _taken(terms: Sequence[Term], linear: Sequence[FloatArray], table: LoadTable) -> FloatArray:
    """Return what limits take from the whole signal, N m: they act on it as it is before."""
    taken = np.zeros(len(table))
    for term, a in zip(terms, linear, strict=True):
        if term.form.cause.whole_signal and term.form.whole:
            taken += term.columns(table) @ a
    return taken


def _jacobian(
    base: FloatArray,
    terms: Sequence[Term],
    linear: Sequence[FloatArray],
    slope: float,
    table: LoadTable,
) -> tuple[FloatArray, list[list[int]]]:
    """Return slopes of the readings over all parameters, and the columns of each term's own.

    -1 stands for a parameter without a slope.
    """
    parts, places = [base.copy()], []
    width = base.shape[1]
    for term, a in zip(terms, linear, strict=True):
        columns = term.columns(table)
        parts[0][:, 0] += columns @ a
        own = [] if term.form.whole else [slope * columns]
        mine = [-1] * len(a) if term.form.whole else list(range(width, width + len(a)))
        width += len(own) * len(a)
        for parameter in term.form.shape:
            change = _shape_slope(term, parameter, a, table)
            mine.append(-1 if change is None else width)
            if change is not None:
                own.append(slope * change[:, None])
                width += 1
        parts += own
        places.append(mine)
    return np.hstack(parts), places


def _shape_slope(
    term: Term, parameter: Parameter, linear: FloatArray, table: LoadTable
) -> FloatArray | None:
    """Return d(torque)/d(shape), N m per unit; None where it has none."""
    if parameter.name in DISCRETE:
        return None
    value = term.shape[parameter.name]
    step = _STEP * max(abs(value), 1e-6)
    low, high = (
        float(np.clip(value + sign * step, parameter.lower, parameter.upper)) for sign in (-1, 1)
    )
    ends = [
        replace(term, shape={**term.shape, parameter.name: x}).columns(table) @ linear
        for x in (low, high)
    ]
    slope = np.asarray((ends[1] - ends[0]) / (high - low))
    return slope if bool(np.any(slope != 0.0)) else None


def _form_error(
    term: Term, linear: FloatArray, slope: float, table: LoadTable, base: FloatArray
) -> FloatArray:
    """Return how a term may differ from its form, one standard deviation each, V.

    Its visible effect times slow factors of load, branch, direction and time; a part of it at
    other values of its shape; and, of what acts on the whole signal, the part that the zeros have
    in it.
    """
    if term.form.discrete:
        return np.zeros((len(table), 0))
    used, effect = table.used, term.columns(table) @ linear

    def seen(columns: FloatArray) -> FloatArray:
        left = np.zeros_like(columns)
        left[used] = columns[used] - base @ (base.T @ columns[used])
        return left

    visible = seen(effect[:, None])
    rms = float(np.sqrt(np.mean(visible[used] ** 2)))
    # Chebyshev polynomials are finer at both ends, where loops begin and plays end
    sign = np.sign(table.torque_nm)
    angle = np.arccos(1.0 - 2.0 * np.abs(table.torque_nm) / table.top_nm)
    waves = [sign * np.cos(k * angle) for k in range(1, _CURVES + 1)]
    branch = np.where(table.falling, 1.0, -1.0)
    time = table.motion.time_s - table.motion.time_s[0]
    time = time / max(float(time[-1]), 1e-300)
    curves = rms * np.column_stack([*waves, *(branch * w for w in waves)])
    slow = visible * np.column_stack([sign, *(np.cos(np.pi * k * time) for k in (1, 2))])
    share = FORM_ERROR if term.form.cause.shape else PLAIN_ERROR
    parts = [share * curves, share * slow]
    size = float(np.linalg.norm(visible))
    for moved in term.neighbours():
        other = seen((moved.columns(table) @ linear - effect)[:, None])
        length = float(np.linalg.norm(other))
        parts.append(SPREAD * other * min(1.0, size / max(length, 1e-300)))
    if term.form.cause.whole_signal:
        alone = term.columns(table.with_signal(table.torque_nm)) @ linear
        parts.append((alone - effect)[:, None])
    return slope * np.hstack(parts)


def _covariances(
    columns: FloatArray,
    forms: FloatArray,
    places: Sequence[Sequence[int]],
    terms: Sequence[Term],
    variance: float,
) -> tuple[FloatArray, ...]:
    """Return the covariance of each term, by noise and form error; zero for what is not known."""
    size = np.sqrt(np.einsum("nk,nk->k", columns, columns))
    size = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh((columns / size).T @ (columns / size))
    good = values > 1e-9 * values[-1]
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(size, size)
    moved = inverse @ (columns.T @ forms)
    covariance = variance * inverse + moved @ moved.T
    blocks = []
    for mine, term in zip(places, terms, strict=True):
        known = [i for i, place in enumerate(mine) if place >= 0]
        index = [mine[i] for i in known]
        block = np.zeros((len(mine), len(mine)))
        block[np.ix_(known, known)] = covariance[np.ix_(index, index)]
        for i, parameter in enumerate(term.form.shape, len(mine) - len(term.form.shape)):
            if not block[i, i] < (parameter.upper - parameter.lower) ** 2:
                block[i, :] = block[:, i] = 0.0
        blocks.append(block)
    return tuple(blocks)


def _refined(terms: tuple[Term, ...], base: FloatArray, table: LoadTable) -> tuple[Term, ...]:
    """Return the terms with shapes of least squares near where they are."""
    from scipy.optimize import least_squares

    free: list[tuple[int, str, float, float]] = []
    for place, term in enumerate(terms):
        for p in term.form.shape:
            if p.name not in DISCRETE:
                value = term.shape[p.name]
                bands = term.form.bounds(p, table)
                inside = [(low, high) for low, high in bands if low <= value <= high]
                free += [(place, p.name, low, high) for low, high in inside[:1]]
    if not free:
        return terms
    response = table.reading_v[table.used]
    scale = float(np.sqrt(response @ response)) or 1.0

    def moved(shares: FloatArray) -> tuple[Term, ...]:
        made = list(terms)
        for (place, name, low, high), share in zip(free, shares.tolist(), strict=True):
            value = low * (high / low) ** share if low > 0.0 else low + (high - low) * share
            shape = {**made[place].shape, name: float(np.clip(value, low, high))}
            made[place] = replace(made[place], shape=shape)
        return tuple(made)

    def residual(shares: FloatArray) -> FloatArray:
        design = _design(base, moved(shares), table)[table.used]
        return np.asarray((response - design @ _solve(design, response)) / scale)

    start = np.array(
        [
            np.log(terms[i].shape[name] / low) / np.log(high / low)
            if low > 0.0
            else (terms[i].shape[name] - low) / (high - low)
            for i, name, low, high in free
        ]
    )
    start = np.clip(start, 0.0, 1.0)
    step = np.full(len(start), _STEP)
    found = least_squares(residual, start, bounds=(0.0, 1.0), diff_step=step, max_nfev=_CALLS)
    before = residual(start)
    return moved(found.x) if 2.0 * found.cost < float(before @ before) else terms
