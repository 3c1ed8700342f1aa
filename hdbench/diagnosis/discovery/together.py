"""Several records of one drive: one search, and what each record says of what was found."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.channel import start_fit
from hdbench.diagnosis.discovery.dictionary import Dictionary
from hdbench.diagnosis.discovery.fit import Fit
from hdbench.diagnosis.discovery.form import USUAL
from hdbench.diagnosis.discovery.heldout import Prediction, gain_between, hold_out
from hdbench.diagnosis.discovery.lines import OUTPUT_LINE, TONE_LINE
from hdbench.diagnosis.discovery.moments import Moments, inverse_scale, solve_best
from hdbench.diagnosis.discovery.naming import name_causes
from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.search import Search, search_from
from hdbench.diagnosis.discovery.stack import (
    EACH,
    ONE,
    SHARED,
    StackedCause,
    coefficients_of,
    piece_fit,
    piece_term,
    stack_fits,
    stacked_causes,
)
from hdbench.diagnosis.discovery.tables import is_table
from hdbench.diagnosis.discovery.term import Term
from hdbench.diagnosis.discovery.told import (
    Told,
    cause_of,
    covariances,
    in_time,
    late_of,
    mean_square,
    place_of,
    predicting_delay,
    rest_places,
    shares_of,
    table_places,
    walk_of,
)
from hdbench.diagnosis.evidence import chi2_tail
from hdbench.model import BenchModel, Cause, CauseTerm, cause_parameters
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import (
    NamedCause,
    ParameterValue,
    Unexplained,
    Voice,
    parameter_values,
)

# rounds in which the noise without a cause is fitted, and with it
_ROUNDS_WITHOUT, _ROUNDS_WITH = 6, 2
# a record that holds less than this share of the information on an amplitude says nothing of it
_BLIND = 1e-6
# directions with less than this share of the largest information are one effect told twice
_SAME = 1e-8


def search_together(
    records: Sequence[Record],
    causes: Mapping[str, Cause],
    known: Sequence[Term],
    *,
    alpha: float,
    rng: np.random.Generator,
    progress: Callable[[str, float], None],
    least_share: float,
) -> Search:
    """Return what several records of one drive hold beyond the baseline of each."""
    fits, start = [start_fit(record) for record in records], None
    every = (*causes.values(), TONE_LINE, OUTPUT_LINE)
    referenced = stack_fits(fits).record.referenced
    stacked = stacked_causes(every, len(records), referenced=referenced)
    held = tuple(Term(stacked[term.name], term.shape, known=True) for term in known)
    while True:
        low = [at for at, one in enumerate(fits) if one.record.low_pass is not None]
        open_ = {at: start_fit(records[at].behind(None)) for at in low}
        fit, *plain = (
            stack_fits([open_[at] if at == one else fit for at, fit in enumerate(fits)])
            for one in (None, *low)
        )
        for one in (fit, *plain):
            for term in held:
                one.add_term(term)
            one.settle(4)
        found = search_from(fit, plain, stacked, held, alpha, rng, progress, least_share, start)
        if isinstance(found, Search):
            return found
        place, start = found
        fits[low[place]] = open_[low[place]]


def piece_searches(search: Search) -> list[tuple[Search, list[int]]]:
    """Return the search as each record has it, and for each of its parts that of the stack."""
    plain = {
        name: cause.plain if isinstance(cause, StackedCause) and cause.plain else cause
        for name, cause in search.catalogue.items()
    }
    out = []
    for number in range(len(search.fit.record.records)):
        fit, origin = piece_fit(search.told, number)
        scans = tuple(scan.parts[number] for scan in search.scans)
        empty = Dictionary((), np.zeros((0, fit.bands.size), dtype=np.float32), [])
        out.append((Search(fit, empty, empty, scans, plain, search.alpha, plain), origin))
    return out


# --- what each record says
@dataclass(frozen=True, slots=True)
class _Own:
    """Amplitudes of a cause as each record alone has them, beside all else that is shared.

    Parameters
    ----------
    linear : ndarray, shape (n_records, k)
        Linear parameters.
    covariance : ndarray, shape (n_records k, n_records k)
        Their covariance.
    seen : ndarray of bool, shape (n_records,)
        Records that say anything of them.
    """

    linear: FloatArray
    covariance: FloatArray
    seen: NDArray[np.bool_]

    def of(self, number: int) -> FloatArray:
        """Return the covariance of one record."""
        k = self.linear.shape[1]
        at = slice(number * k, (number + 1) * k)
        return self.covariance[at, at]


def _likelihoods(fit: Fit, moments: Moments, rounds: int) -> FloatArray:
    """Return the log likelihood of each record with coefficients and noise fitted anew, nats."""
    solved = solve_best(moments, fit.shapes, fit.spectrum, rounds=rounds)
    noise = solved.spectrum.power
    nats = -0.5 * (moments.counts * np.log(noise) + moments.left(solved.step) / noise)
    ends = np.searchsorted(fit.bands.edges, [at.stop for at in coefficients_of(fit)])
    return np.diff(np.concatenate([[0.0], np.cumsum(nats)[ends - 1]]))


def _evidence(fit: Fit, part: int) -> FloatArray:
    """Return by how much the likelihood of each record falls without a cause, nats."""
    with_it = _likelihoods(fit, fit.moments(), _ROUNDS_WITH)
    return with_it - _likelihoods(fit, fit.beside(part).moments, _ROUNDS_WITHOUT)


def _own_sizes(fit: Fit, part: int, kind: str) -> _Own:
    """Return the amplitudes of a cause with those of each record free."""
    pieces = coefficients_of(fit)
    flat = fit.flat(part)
    rows, scale = fit.rows[flat], fit.parts[part].scale
    if kind == SHARED:
        split = np.zeros((len(pieces), *rows.shape))
        for own, at in zip(split, pieces, strict=True):
            own[:, at] = rows[:, at]
        rows, scale = split.reshape(-1, rows.shape[1]), np.tile(scale, len(pieces))
    beside = fit.beside(part)
    products = beside.products(rows)
    moments = beside.moments.enlarged(
        products.cross[:, :, beside.kept], products.own, products.right, fit.parts[part].moving
    )
    solved = solve_best(moments, fit.shapes, fit.spectrum)
    count = len(rows)
    information = np.diag(solved.information)[-count:].reshape(len(pieces), -1).sum(axis=1)
    # harmonics of two causes may be one and the same: what both say counts for half in each
    root = inverse_scale(np.diag(solved.information))
    scaled = solved.information * np.outer(root, root)
    covariance = np.linalg.pinv(scaled, rcond=_SAME, hermitian=True) * np.outer(root, root)
    covariance = covariance[-count:, -count:] / np.outer(scale, scale)
    linear = (solved.step[-count:] / scale).reshape(len(pieces), -1)
    return _Own(linear, covariance, information > _BLIND * information.max())


def _sizes(own: _Own, kind: str) -> tuple[FloatArray, FloatArray]:
    """Return what of the amplitudes must be alike, by record, and its covariance.

    Of a line whose phase begins anew in each record that is its size alone.
    """
    if kind == SHARED:
        return own.linear, own.covariance
    size = np.linalg.norm(own.linear, axis=1)
    along = own.linear / np.maximum(size, 1e-300)[:, None]
    count, k = along.shape
    turn = np.zeros((count, count * k))
    for number in range(count):
        turn[number, number * k : (number + 1) * k] = along[number]
    return size[:, None], turn @ own.covariance @ turn.T


def _apart(values: FloatArray, covariance: FloatArray, numbers: Sequence[int]) -> float:
    """Return the chance that records scatter so far about one value that they share.

    A law is known to a few per cent only: so far their values may differ beyond their noise.
    """
    k = values.shape[1]
    at = np.concatenate([np.arange(n * k, (n + 1) * k) for n in numbers])
    some = values[list(numbers)]
    scale = np.sqrt(np.maximum(np.mean(some**2, axis=0), 1e-300))
    some = some / scale
    matrix = covariance[np.ix_(at, at)] / np.outer(*[np.tile(scale, len(numbers))] * 2)
    matrix = matrix + USUAL**2 * np.eye(len(at))
    mean = np.tile(np.eye(k), (len(numbers), 1))
    weight = np.linalg.pinv(matrix, hermitian=True)
    inner = np.linalg.pinv(mean.T @ weight @ mean, hermitian=True)
    left = some.ravel() - mean @ (inner @ (mean.T @ weight @ some.ravel()))
    return chi2_tail(float(left @ weight @ left), k * (len(numbers) - 1))


def _disagreeing(own: _Own, kind: str, alpha: float) -> tuple[float, list[int]]:
    """Return the chance of the scatter of all records, and those without which the others agree."""
    values, covariance = _sizes(own, kind)
    numbers = np.flatnonzero(own.seen).tolist()
    if len(numbers) < 2:
        return 1.0, []
    chance = now = _apart(values, covariance, numbers)
    out: list[int] = []
    while now < alpha:
        if len(numbers) == 2:
            return chance, sorted([*out, *numbers])
        rest = [[n for n in numbers if n != one] for one in numbers]
        chances = [_apart(values, covariance, some) for some in rest]
        best = int(np.argmax(chances))
        out.append(numbers[best])
        numbers, now = rest[best], chances[best]
    return chance, sorted(out)


def _apart_terms(
    fit: Fit, part: int, terms: list[CauseTerm | None], alpha: float
) -> tuple[float | None, list[int], list[CauseTerm | None]]:
    """Return the chance that records differ so far, which ones do, and the cause as each has it.

    Slow changes of the zero, and what is in one record alone, may differ: no chance is given.
    """
    cause = fit.term(part).cause
    kind = _kind(cause)
    if kind == ONE or (kind == EACH and cause.locked_to == "time"):
        return None, [], terms
    own = _own_sizes(fit, part, kind)
    chance, apart = _disagreeing(own, kind, alpha)
    if kind == EACH:
        return chance, apart, terms
    told: list[CauseTerm | None] = []
    for number, (term, seen) in enumerate(zip(terms, own.seen, strict=True)):
        if term is None or not seen:
            told.append(None)
            continue
        linear = _within(own.linear[number], cause)
        matrix = tuple(tuple(map(float, row)) for row in own.of(number))
        told.append(CauseTerm(term.name, term.shape, linear, matrix))
    return chance, apart, told


def _kind(cause: Cause) -> str:
    return cause.kind if isinstance(cause, StackedCause) else SHARED


def _within(linear: FloatArray, cause: Cause) -> tuple[float, ...]:
    """Return linear parameters cut to their domains."""
    pairs = zip(linear, cause.linear, strict=False)
    return tuple(float(np.clip(value, p.lower, p.upper)) for value, p in pairs)


def _term_of(fit: Fit, part: int, number: int, matrix: FloatArray) -> CauseTerm | None:
    """Return a cause as one record has it; None where it is a table or in another record."""
    term = piece_term(fit.term(part), fit.record, number)
    if is_table(term.cause):
        return None
    kind, linear = _kind(fit.term(part).cause), fit.linear(part)
    k = len(term.cause.linear)
    at = np.arange(len(matrix))
    if kind == EACH:
        at = np.r_[number * k : (number + 1) * k, len(linear) : len(matrix)]
        linear = linear[number * k : (number + 1) * k]
    if kind == ONE and not _inside(term, fit.record.records[number]):
        return None
    own = matrix[np.ix_(at, at)]
    values = _within(linear, term.cause)
    return CauseTerm(
        term.name, dict(term.shape), values, tuple(tuple(map(float, row)) for row in own)
    )


def _inside(term: Term, record: Record) -> bool:
    time = record.motion.time_s
    return bool(time[0] <= term.shape["step_time_s"] <= time[-1])


def _stated(term: CauseTerm | None, model: BenchModel) -> dict[str, ParameterValue]:
    """Return the sizes of a cause in one record, without the shape that all share."""
    if term is None:
        return {}
    table = cause_parameters(term, extra=model.extra_causes)
    return parameter_values({k: entry for k, entry in table.items() if k not in term.shape})


# --- the answer
@dataclass(frozen=True, slots=True)
class Together:
    """What a search of several records found.

    Parameters
    ----------
    search : Search
        Search of the stack.
    causes : list of NamedCause
        Causes with what each record says of them.
    places : list of Unexplained
        Places without a name.
    before, after : Prediction
        Held-out blocks of all records predicted by their baselines, and by all that was found.
    records : list of (Search, Told)
        The same as each record has it.
    """

    search: Search
    causes: list[NamedCause]
    places: list[Unexplained]
    before: Prediction
    after: Prediction
    records: list[tuple[Search, Told]]


def tell_together(
    search: Search,
    model: BenchModel,
    names: Sequence[str],
    rng: np.random.Generator,
    noise_variances: Sequence[FloatArray | None],
) -> Together:
    """Return what a search of several records found as the answer says it."""
    named = name_causes(search)
    fit = search.fit
    search.find_tables()
    held = hold_out(fit)
    everything = set(range(len(fit.parts)))
    base = everything - set(fit.causes())
    before, after = held.predict(base), held.predict(everything)
    each_before, each_after = held.predict_each(base), held.predict_each(everything)
    variance = mean_square(fit, base)
    shares, matrices = shares_of(fit, variance), covariances(fit)
    alpha = search.alpha / max(1, len(named))
    causes: list[NamedCause] = []
    places: list[Unexplained] = []
    kept: set[int] = {i for i, part in enumerate(fit.parts) if part.term and part.term.known}
    for index in fit.causes():
        term = fit.term(index)
        chance = fit.parts[index].false_alarm
        if is_table(term.cause):
            places.append(place_of(fit, index, shares[index], chance))
            continue
        without = held.predict(everything - {index})
        if without.chi2 <= after.chi2:
            search.log.append(f"{term.name} predicts nothing")
            continue
        kept.add(index)
        gain = gain_between(without, after, rng)
        each = zip(held.predict_each(everything - {index}), each_after, strict=True)
        gains = [gain_between(a, b, rng) for a, b in each]
        terms = [_term_of(fit, index, number, matrices[index]) for number in range(len(names))]
        nats = _evidence(fit, index)
        chance_apart, apart, alone = _apart_terms(fit, index, terms, alpha)
        most = int(np.argmax(np.where([t is not None for t in terms], nats, -np.inf)))
        best = terms[most]
        if best is None:
            continue
        voices = tuple(
            Voice(
                names[number],
                float(nats[number]),
                gains[number],
                _stated(alone[number], model),
                number in apart,
            )
            for number in range(len(names))
        )
        cause = cause_of(named[index], best, model, gain, shares[index], chance)
        causes.append(cause.heard(voices, chance_apart))
    places += table_places(search, variance)
    records = []
    for number, (one, origin) in enumerate(piece_searches(search)):
        predicting_delay(one)
        early = in_time(one.fit)
        square = mean_square(one.fit, {i for i, place in enumerate(origin) if place in base})
        found = rest_places(one, square, noise_variances[number])
        found = [replace(place, record=names[number]) for place in found]
        special = [x for x in (walk_of(one, square), late_of(one, early, rng)) if x is not None]
        every = [_term_of(fit, place, number, matrices[place]) for place in origin if place in kept]
        own_terms = [own for own in every if own is not None]
        for cause, own_term in special:
            voice = Voice(names[number], cause.evidence_nats, cause.gain, {}, False)
            causes.append(cause.heard([voice]))
            own_terms.append(own_term)
        places += found
        told = Told(one.fit, [], found, each_before[number], each_after[number], own_terms)
        records.append((one, told))
    for _, told in records:
        held_names = {term.name for term in told.terms}
        told.causes += [cause for cause in causes if cause.name in held_names]
    return Together(search, causes, places, before, after, records)
