"""Joint fit of gain, zeros and causes with their form error, and how it predicts readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.heldout import Prediction, gain_between
from hdbench.diagnosis.evidence import RANK, marginal_nats, orthonormal, scaled
from hdbench.diagnosis.loads.forms import Term
from hdbench.diagnosis.loads.table import IntArray, LoadTable, levels, one_hot
from hdbench.model import Parameter
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import Gain

# form error, as a share of the effect, of each way in which it may differ from its form: a law of
# a mechanism (a loop, a creep, a limit) is good to a few percent; a polynomial, which is its own
# definition, to the curve of second order that an arm or a weight adds
FORM_ERROR, PLAIN_ERROR = 0.04, 0.003


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

    def directions(self, columns: FloatArray) -> FloatArray:
        """Return an orthonormal basis of what the fit leaves of columns, shape (dof, rank)."""
        raw = columns[self.used]
        if not np.isfinite(raw).all():
            return np.zeros((self.dof, 0))
        u, s, _ = np.linalg.svd(self.basis.T @ scaled(raw)[0], full_matrices=False)
        # what is left of a column below this share of its size is what the fit has already
        return np.asarray(u[:, s > 1e-5])

    def share(self, directions: FloatArray) -> float:
        """Return which share of the residual's sum of squares lies along directions."""
        along, rss = directions.T @ self.residual_v, self.residual_v @ self.residual_v
        return float(along @ along / rss) if rss > 0.0 else 0.0

    def seen(self, effect: FloatArray) -> FloatArray:
        """Return what the fit leaves of an effect, at the readings of the fit."""
        return np.asarray(self.basis @ (self.basis.T @ effect[self.used]))


@dataclass(frozen=True, slots=True)
class LoadFit:
    """Result of a joint fit."""

    table: LoadTable  # with the signal of this fit, before any limit
    base: FloatArray  # columns of the baseline, the applied torque first
    terms: tuple[Term, ...]
    slope_v_per_nm: float  # one over the gain
    baseline_v: FloatArray  # coefficients of the baseline's columns
    linear: tuple[FloatArray, ...]  # of each term
    covariances: tuple[FloatArray, ...]  # of these, then free shapes; 0 where not known
    fitted_v: FloatArray
    explained: FloatArray  # columns that span the fit, slopes over shapes too
    forms_v: FloatArray  # form errors, one standard deviation each
    noise_v2: float
    rss: float
    dof: int  # readings less resolved parameters
    nats: float  # evidence

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

    def others(self, places: Sequence[int]) -> tuple[Term, ...]:
        """Return the terms but for some."""
        return tuple(term for i, term in enumerate(self.terms) if i not in places)

    def refit(self, terms: Sequence[Term], *, refine: bool = False) -> LoadFit:
        """Return the fit of other terms, shapes as they are unless `refine` is True."""
        return fit_loads(self.table, self.base, terms, refine=refine)

    def space(self) -> Space:
        """Return what the fit leaves of the readings."""
        used = self.table.used
        u, s, _ = np.linalg.svd(self.forms_v[used], full_matrices=False)
        less = 1.0 - 1.0 / np.sqrt(1.0 + s**2 / max(self.noise_v2, 1e-300))

        def white(columns: FloatArray) -> FloatArray:
            # symmetric root of the inverse of 1 + U U^T / s^2
            return np.asarray(columns - (u * less) @ (u.T @ columns))

        known = orthonormal(white(self.explained[used]))
        basis = white(np.linalg.qr(known, mode="complete")[0][:, known.shape[1] :])
        return Space(used, basis, basis.T @ self.table.reading_v[used])


def fit_loads(
    table: LoadTable, base: FloatArray, terms: Sequence[Term], *, refine: bool = True
) -> LoadFit:
    """Fit gain, zeros and causes together, shapes too unless `refine` is False."""
    chosen = tuple(terms)
    acts = any(term.form.cause.whole_signal for term in chosen)
    # a limit acts on the signal before it, which the fit gives: they settle in four rounds, or when
    # nothing moves any more
    for _ in range(4 if acts else 1):
        chosen = _refined(chosen, base, table) if refine else chosen
        fit = _linear_fit(table, base, chosen)
        moved = np.asarray(fit.table.motion.simulated_nm) - np.asarray(table.motion.simulated_nm)
        table = fit.table
        if float(np.abs(moved).max()) <= 1e-6 * table.top_nm:
            break
    return fit


def design(base: FloatArray, terms: Sequence[Term], table: LoadTable) -> list[FloatArray]:
    """Return the columns of baseline and terms; what takes a share of 1 is part of the torque."""
    parts = [base.copy()]
    for term in terms:
        columns = term.columns(table)
        if term.form.whole:
            parts[0][:, 0] += columns[:, 0]
        parts.append(columns[:, :0] if term.form.whole else columns)
    return parts


def _solve(columns: FloatArray, response: FloatArray) -> FloatArray:
    """Return the least-squares solution of least norm in scaled columns."""
    known, size = scaled(columns)
    return np.asarray(np.linalg.lstsq(known, response, rcond=RANK)[0] / size)


def _linear_fit(table: LoadTable, base: FloatArray, terms: tuple[Term, ...]) -> LoadFit:
    used, response = table.used, table.reading_v[table.used]
    n = len(response)
    # readings carry rounding at this share of the largest one
    rounding = 1e-12
    floor = (rounding * float(np.abs(response).max())) ** 2
    parts = design(base, terms, table)
    columns = np.hstack(parts)
    solution = _solve(columns[used], response)
    fitted = columns @ solution
    left = response - fitted[used]
    slope = float(solution[0]) if abs(solution[0]) > rounding else rounding
    own = np.split(solution, np.cumsum([part.shape[1] for part in parts]))
    linear = tuple(a / slope if len(a) else np.ones(1) for a in own[1:-1])
    # what limits take acts on the signal before them
    taken = np.zeros(len(table))
    slopes, errors = [base.copy()], [np.zeros((len(table), 0))]
    first = orthonormal(base[used])
    for term, a in zip(terms, linear, strict=True):
        form, torque = term.form, term.columns(table)
        slopes[0][:, 0] += torque @ a
        if form.cause.whole_signal:
            taken += torque @ a
        slopes.append(slope * (np.zeros_like(torque) if form.whole else torque))
        slopes += [slope * _shape_slope(term, p, a, table)[:, None] for p in form.shape]
        if form.smooth == form.shape:
            errors.append(slope * _form_error(term, a, table, first))
    explained, forms = np.hstack(slopes), np.hstack(errors)
    basis = orthonormal(explained[used])
    seen = forms[used] - basis @ (basis.T @ forms[used])
    compared, dof = n - first.shape[1], n - basis.shape[1]
    nats, variance = marginal_nats(left, seen, compared, floor)
    variance *= compared / max(dof, 1)
    added = compared - dof + sum(len(t.form.shape) - len(t.form.smooth) for t in terms)
    return LoadFit(
        table.with_signal(fitted / slope - taken),
        base,
        terms,
        slope,
        own[0],
        linear,
        _covariances(explained[used], forms[used], terms, variance),
        fitted,
        explained,
        forms,
        variance,
        max(float(left @ left), n * floor),
        dof,
        nats - 0.5 * added * float(np.log(n)) - sum(t.form.prior_nats for t in terms),
    )


def _shape_slope(
    term: Term, parameter: Parameter, linear: FloatArray, table: LoadTable
) -> FloatArray:
    """Return d(torque)/d(shape), N m per unit; 0 where it has none."""
    if parameter not in term.form.smooth:
        return np.zeros(len(table))
    value = term.shape[parameter.name]
    step = 1e-4 * max(abs(value), 1e-6)
    low, high = np.clip((value - step, value + step), parameter.lower, parameter.upper).tolist()
    before, after = (
        replace(term, shape={**term.shape, parameter.name: x}).columns(table) @ linear
        for x in (low, high)
    )
    return np.asarray((after - before) / (high - low))


def _form_error(term: Term, linear: FloatArray, table: LoadTable, base: FloatArray) -> FloatArray:
    """Return how a term may differ from its form, one standard deviation each, N m."""
    used, effect = table.used, term.columns(table) @ linear

    def seen(torque: FloatArray) -> FloatArray:
        left = np.zeros((len(torque), 1))
        left[used, 0] = torque[used] - base @ (base.T @ torque[used])
        return left

    visible = seen(effect)
    rms = float(np.sqrt(np.mean(visible[used] ** 2)))
    # Chebyshev polynomials are finer at both ends, where loops begin and plays end
    sign = np.sign(table.torque_nm)
    angle = np.arccos(1.0 - 2.0 * np.abs(table.torque_nm) / table.top_nm)
    # polynomials of the load in a form error: as many as a calibration has levels, and more
    waves = [sign * np.cos(k * angle) for k in range(1, 6 + 1)]
    branch = np.where(table.falling, 1.0, -1.0)
    time = table.motion.time_s - table.motion.time_s[0]
    time = time / max(float(time[-1]), 1e-300)
    curves = rms * np.column_stack([*waves, *(branch * w for w in waves)])
    slow = visible * np.column_stack([sign, *(np.cos(np.pi * k * time) for k in (1, 2))])
    share = FORM_ERROR if term.form.cause.shape else PLAIN_ERROR
    parts = [share * curves, share * slow]
    size = float(np.linalg.norm(visible))
    for moved in term.neighbours():
        other = seen(moved.columns(table) @ linear - effect)
        length = float(np.linalg.norm(other))
        # part of an effect that may stand at other values of its shape: plays, limits, yields and
        # time constants are spread in real parts
        parts.append(0.2 * other * min(1.0, size / max(length, 1e-300)))
    if term.form.cause.whole_signal:
        # the zeros have a part in what acts on the whole signal
        alone = term.columns(table.with_signal(table.torque_nm)) @ linear
        parts.append((alone - effect)[:, None])
    return np.hstack(parts)


def _covariances(
    columns: FloatArray, forms: FloatArray, terms: Sequence[Term], variance: float
) -> tuple[FloatArray, ...]:
    """Return the covariance of each term, by noise and form error; zero for what is not known."""
    unit, size = scaled(columns)
    values, vectors = np.linalg.eigh(unit.T @ unit)
    # a parameter without a slope has exactly nothing
    vectors = vectors * np.any(columns != 0.0, axis=0)[:, None]
    good = values > RANK * values[-1]
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(size, size)
    moved = inverse @ (columns.T @ forms)
    covariance = variance * inverse + moved @ moved.T
    blocks: list[FloatArray] = []
    end = len(covariance)
    for term in reversed(terms):
        form = term.form
        begin = end - len(form.parameters) - len(form.beside) - len(form.shape)
        block = covariance[begin:end, begin:end].copy()
        for i, parameter in enumerate(form.shape, len(block) - len(form.shape)):
            if not block[i, i] < (parameter.upper - parameter.lower) ** 2:
                block[i, :] = block[:, i] = 0.0
        blocks.insert(0, block)
        end = begin
    return tuple(blocks)


def _refined(terms: tuple[Term, ...], base: FloatArray, table: LoadTable) -> tuple[Term, ...]:
    """Return the terms with shapes of least squares near where they are."""
    from scipy.optimize import least_squares

    free: list[tuple[int, str, float, float]] = []
    for place, term in enumerate(terms):
        for p in term.form.smooth:
            bands = term.form.bounds(p, table)
            inside = [band for band in bands if band[0] <= term.shape[p.name] <= band[1]]
            free += [(place, p.name, *band) for band in inside[:1]]
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
        columns = np.hstack(design(base, moved(shares), table))[table.used]
        return np.asarray((response - columns @ _solve(columns, response)) / scale)

    def share_of(value: float, low: float, high: float) -> float:
        if low > 0.0:
            return float(np.log(value / low) / np.log(high / low))
        return (value - low) / (high - low)

    at = [share_of(terms[i].shape[name], low, high) for i, name, low, high in free]
    start = np.clip(at, 0.0, 1.0)
    steps = [1e-4] * len(free)
    # refinement ends after this many steps: grids start it within a fifth of where it ends
    found = least_squares(residual, start, bounds=(0.0, 1.0), diff_step=steps, max_nfev=30)
    before = residual(start)
    return moved(found.x) if 2.0 * found.cost < float(before @ before) else terms


# --- readings left out
def _fold_kinds(table: LoadTable) -> list[tuple[str, IntArray]]:
    """Return the ways to leave readings out that this table allows, the best one first."""
    level = levels(table)
    kinds = [("experiment", table.experiment)] if len(table.names) > 2 else []
    if level.max() > 2 and len(level) > level.max() + 1:
        kinds.append(("load level", level))
    return [*kinds, ("reading", np.arange(len(table), dtype=np.int64))]


def held_out(baseline: LoadFit, fit: LoadFit) -> tuple[str, float | None, float | None]:
    """Return what was left out together, and the RMS of baseline and final model on it, N m."""
    kinds = _fold_kinds(fit.table)
    for name, folds in kinds:
        before, after = _predicted_nm(baseline, folds), _predicted_nm(fit, folds)
        if before is not None and after is not None:
            return name, rms(before), rms(after)
    return kinds[-1][0], None, None


def gain_of(fit: LoadFit, places: Sequence[int], rng: np.random.Generator) -> Gain:
    """Return the held-out gain of a cause by the best way of leaving out that it allows."""
    table, used = fit.table, fit.table.used
    effect = np.sum([fit.effect_nm(place) for place in places], axis=0)
    seen = fit.refit(fit.others(places)).space().seen(effect) ** 2
    for _, folds in _fold_kinds(table):
        parts = np.bincount(folds[used], weights=seen)
        # a fold with more of an effect's sum of squares than this is not predicted by the others
        if parts.max() > 0.5 * parts.sum():
            continue
        before, after = _predicted_nm(fit, folds, places), _predicted_nm(fit, folds)
        if before is not None and after is not None:
            # fewer units than this cannot carry a bootstrap: readings are drawn instead
            many = len(np.unique(table.experiment[used])) >= 5
            units = one_hot(table.experiment[used] if many else np.arange(len(before))).T
            old, new = (Prediction(units @ x**2, units.sum(axis=1), 0.0) for x in (before, after))
            return gain_between(old, new, rng)
    return Gain(fit.noise_nm, fit.noise_nm, 0.0, (0.0, 0.0))


def _predicted_nm(fit: LoadFit, folds: IntArray, places: Sequence[int] = ()) -> FloatArray | None:
    """Return measured less predicted of each fold from all others, N m."""
    table, used = fit.table, fit.table.used
    response, numbers = table.reading_v[used], folds[used]
    columns = np.hstack(design(fit.base, fit.others(places), table))[used]
    of_zeros = np.s_[1 : 1 + len(table.names)]
    zeros = columns[:, of_zeros]
    columns = scaled(columns)[0]
    columns[:, of_zeros] = zeros
    left = np.full(len(response), np.nan)
    for number in np.unique(numbers):
        test = numbers == number
        u, s, v = np.linalg.svd(columns[~test], full_matrices=False)
        kept = s > RANK * s[0]
        u, s, v = u[:, kept], s[kept], v[kept]
        # a zero that no training reading shows may be unknown, nothing else: it is the mean of
        # the residuals, and what stays is scaled to a prediction with a known zero
        asked = columns[test]
        asked[:, of_zeros] = 0.0
        unknown = np.linalg.norm(asked - asked @ v.T @ v, axis=1)
        # a reading that is alone in fixing a coefficient says nothing about the prediction
        if float(unknown.max(initial=0.0)) > 3e-5:
            return None
        left[test] = response[test] - columns[test] @ (v.T @ (u.T @ response[~test] / s))
        for column in np.flatnonzero(~zeros[~test].any(axis=0)):
            mine = np.flatnonzero(test & (zeros[:, column] > 0.0))
            if len(mine) > 1:
                spread = left[mine] - left[mine].mean()
                left[mine] = spread * np.sqrt(len(mine) / (len(mine) - 1.0))
    return left / fit.slope_v_per_nm


def rms(values: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))
