"""Told: what a search found, as causes, places without a name and numbers of the answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.answer.result import Spectrum
from hdbench.diagnosis.discovery.channel import DELAY, best_delay
from hdbench.diagnosis.discovery.fit import Fit, scaled_rows
from hdbench.diagnosis.discovery.form import USUAL, formed_share, usual_scale
from hdbench.diagnosis.discovery.heldout import HeldOut, Prediction, gain_between, hold_out
from hdbench.diagnosis.discovery.joint import is_within, sized
from hdbench.diagnosis.discovery.lines import scan_power
from hdbench.diagnosis.discovery.moments import solve
from hdbench.diagnosis.discovery.naming import Named, name_causes
from hdbench.diagnosis.discovery.refine import candidate_of, weighed
from hdbench.diagnosis.discovery.rest import find_burst, find_humps
from hdbench.diagnosis.discovery.search import (
    SHARES,
    SLOW_PRICE,
    Search,
    settled,
)
from hdbench.diagnosis.discovery.spectrum import Shapes
from hdbench.diagnosis.discovery.spectrum import Spectrum as Noise
from hdbench.diagnosis.discovery.tables import TABLE, axes_of, is_table
from hdbench.diagnosis.discovery.term import (
    resolution,
    smooth_shapes,
    tangent_columns,
    term_columns,
)
from hdbench.diagnosis.evidence import RIVAL_NATS, SPANS, chi2_level, chi2_tail
from hdbench.model import BenchModel, CauseTerm, cause_parameters
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import (
    Detectable,
    Gain,
    NamedCause,
    ParameterValue,
    Unexplained,
    parameter_values,
)

DOMAINS = {
    "motor": "motor-order",
    "output": "output-order",
    "clock": "frequency",
    "velocity": "velocity",
    "acceleration": "acceleration",
    "load": "torque",
    "time": "time",
}
# axes of lines without a name
_LINES = {"tone": "frequency", "output-line": "output-order"}
# an effect is found with 90 % where its size is so many standard deviations above the threshold
_POWER = 1.28
# cells of a spectrum that a picture can show
_SPECTRUM_POINTS = 2000
# a random walk has power like 1/f^2, flicker like 1/f: odds of 20 to 1 tell them apart; seventeen
# more shapes that fall fit the scatter to some ten nats; single lines so many standard deviations
# beyond normal noise are no noise
_STEEPER_NATS, _FREE_NATS, _UNSTEADY = 3.0, 10.0, 5.0
# pieces of a record disagree about what a cause saves by so many standard deviations by chance
_BY_CHANCE = 2.0
# humps that hold less than this share of what is left are no rest
_HUMP_SHARE = 0.1


@dataclass(slots=True)
class Told:
    """What a search found, in the words of the answer.

    Parameters
    ----------
    fit : Fit
        Joint fit.
    causes : list of NamedCause
        Every cause, material or not.
    places : list of Unexplained
        Every place without a name.
    before, after : Prediction
        Held-out blocks predicted by the baseline, and by all that was found.
    terms : list of CauseTerm
        Causes as the model file writes them.
    """

    fit: Fit
    causes: list[NamedCause]
    places: list[Unexplained]
    before: Prediction
    after: Prediction
    terms: list[CauseTerm]


def tell(
    search: Search,
    model: BenchModel,
    rng: np.random.Generator,
    noise_variance: FloatArray | None = None,
) -> Told:
    """Return what a search found as the answer says it."""
    named = name_causes(search)
    predicting_delay(search)
    named, held = predicting(search, named)
    fit, early = search.fit, in_time(search.fit)
    search.find_tables()
    everything = set(range(len(fit.parts)))
    base = {i for i in everything if i not in fit.causes()}
    # a table could take in what a name explains, and no model has it: names predict without it
    names = everything - set(fit.tables())
    before, after = hold_out(early).predict(base), held.predict(names)
    variance = mean_square(early, base)
    sizes, sized_parts = sized(fit)
    matrices = covariances(sizes)
    causes: list[NamedCause] = []
    places: list[Unexplained] = []
    terms: list[CauseTerm] = [late_term(fit)] if fit.record.late_known else []
    shares = shares_of(fit, variance)
    for index, part in enumerate(fit.parts):
        term = part.term
        if term is None:
            # a ripple of the baseline that departs from its form is told as a place, not as a cause
            if part.name.startswith("ripple:") and part.form_scale > 0.0:
                places += form_places(search, index, variance)
            continue
        if not is_table(term.cause):
            at = sized_parts.index(index)
            linear = tuple(
                float(np.clip(x, p.lower, p.upper))
                for x, p in zip(sizes.linear(at), term.cause.linear, strict=True)
            )
            matrix = tuple(tuple(map(float, row)) for row in matrices[at])
            terms.append(CauseTerm(term.name, dict(term.shape), linear, matrix))
        if term.known:
            continue
        one = named[index]
        chance = part.false_alarm
        if is_table(term.cause):
            places.append(place_of(fit, index, shares[index], chance))
            continue
        without = held.predict(names - {index})
        gain = gain_between(without, after, rng)
        causes.append(cause_of(one, terms[-1], model, gain, shares[index], chance))
        places += form_places(search, index, variance)
    for special in (walk_of(search, variance), late_of(search, early, rng)):
        if special is not None:
            causes.append(special[0])
            terms.append(special[1])
    # bursts and humps are told beside a table of the same axis: neither holds the other's torque
    places = distinct(places + table_places(search, variance))
    places += rest_places(search, variance, noise_variance)
    return Told(fit, causes, places, before, after, terms)


def distinct(places: list[Unexplained]) -> list[Unexplained]:
    """Return places without those that a larger one on the same axes overlaps."""
    kept: list[Unexplained] = []
    for place in sorted(places, key=lambda one: -one.size_nm):
        axes, (low, high) = (place.domain, place.second_domain), place.extent
        if not any(
            (other.domain, other.second_domain) == axes
            and low <= other.extent[1]
            and other.extent[0] <= high
            for other in kept
        ):
            kept.append(place)
    return kept


def predicting(search: Search, named: Mapping[int, Named]) -> tuple[dict[int, Named], HeldOut]:
    """Take out of a search the causes that predict nothing beside the others, or are too large.

    The latest goes first: of two that can stand for each other one stays.
    """
    fit = search.fit
    held = hold_out(fit)
    names = set(range(len(fit.parts))) - set(fit.tables())
    while True:
        whole = held.predict(names)
        some = [p for p in fit.causes() if p in names and not is_table(fit.term(p).cause)]
        without = {part: held.predict(names - {part}) for part in some}
        idle = [
            part
            for part, x in without.items()
            if x.chi2 <= whole.chi2 or _spoils(whole, x) or not is_within(fit, part)
        ]
        if not idle:
            break
        search.log.append(f"{fit.parts[idle[-1]].name} predicts nothing")
        names.remove(idle[-1])
    gone = sorted(set(range(len(fit.parts))) - names - set(fit.tables()))
    if not gone:
        return dict(named), held
    search.fit = fit.without(*gone)
    kept = [part for part in range(len(fit.parts)) if part not in gone]
    return {at: named[old] for at, old in enumerate(kept) if old in named}, hold_out(search.fit)


def _spoils(whole: Prediction, without: Prediction) -> bool:
    """Return whether a prediction in N m is worse than without a cause, by more than chance.

    Noise that is no white one weighs there as it is: a small line beside it saves by chance.
    """
    saved = without.squares - whole.squares
    return float(saved.sum()) < -_BY_CHANCE * float(np.sqrt(saved @ saved))


def predicting_delay(search: Search) -> None:
    """Take a delay of the torque out of a search where it predicts nothing."""
    late, early = search.fit, in_time(search.fit)
    if early is not late:
        everything = set(range(len(late.parts)))
        errors = [hold_out(fit).predict(everything).rms_nm for fit in (late, early)]
        if errors[1] <= errors[0]:
            search.log.append("time-skew predicts nothing")
            search.fit = early


def table_places(search: Search, variance: float) -> list[Unexplained]:
    """Return the places of the tables in what no name explains."""
    fit = search.told
    if fit is search.fit:
        return []
    held = {search.fit.parts[part].name for part in search.fit.tables()}
    shares = shares_of(fit, variance)
    new = [part for part in fit.tables() if fit.parts[part].name not in held]
    return [place_of(fit, part, shares[part], fit.parts[part].false_alarm) for part in new]


def form_places(search: Search, part: int, variance: float) -> list[Unexplained]:
    """Return the axis of a form error: of a cause where that is more than a name may miss."""
    if search.fit.parts[part].term is not None and formed_share(search.fit, part) > SPANS:
        return []
    view = search.fit.copy()
    view.parts[part].form_scale = usual_scale(view.parts[part])
    view.settle(2)
    beside = view.beside()
    look = search.best_table(view, beside)
    if look is None:
        return []
    found = candidate_of(beside, view.record, look.term, look.trials, look.false_alarm)
    found = weighed(beside, view.record, found, view.shapes, settled(beside, view))
    search.log.append(f"form of {view.parts[part].name}: {found.name} E={found.evidence_nats:.0f}")
    if found.evidence_nats < RIVAL_NATS or look.false_alarm > search.alpha * SHARES["table"]:
        return []
    before = set(range(len(view.parts)))
    new = view.add_term(found.term)
    view.settle(2)
    share = (mean_square(view, before) - mean_square(view, {*before, new})) / variance
    return [place_of(view, new, float(np.clip(share, 0.0, 1.0)), look.false_alarm)]


def walk_of(search: Search, variance: float) -> tuple[NamedCause, CauseTerm] | None:
    """Return a random walk of the zero where slow noise is likely one; None without.

    What a table says over the motion is none.
    """
    fit, cause = search.told, search.catalogue.get("zero-random-walk")
    if cause is None or not fit.shapes.with_slow or cause.applicable(fit.record.motion) is not None:
        return None
    fit = fit.without(*(part for part in fit.tables() if "time" in fit.parts[part].name))
    power = fit.bands.power(fit.residual) / np.maximum(fit.bands.counts, 1e-9)
    slow = [fit.shapes.with_only(k) for k in range(3)]
    fits = [_likelihood(shapes, power, fit.bands.counts) for shapes in slow]
    (none, fast), (flicker, _), (walking, both) = fits
    gain = walking - none - SLOW_PRICE
    chance = chi2_tail(2.0 * max(walking - none, 0.0), 2)
    if chance > search.alpha * SHARES["burst"] or walking < flicker + _STEEPER_NATS:
        return None
    free, _ = _likelihood(fit.shapes.without_bumps(), power, fit.bands.counts)
    if walking < free - _FREE_NATS or not _is_steady(fit, both.power, fast.power):
        return None
    # power at f of summed steps of intensity^2 period: intensity^2 / ((2 pi f)^2 period)
    walk = both.amounts[slow[2].slow] @ slow[2].table[slow[2].slow]
    step = 2.0 * np.pi * fit.bands.frequency_hz[-1] * float(np.sqrt(walk[-1] * fit.record.period_s))
    intensity = min(max(step, 1e-6), 100.0)
    speaking = float(fit.bands.counts @ (walk / both.power) ** 2)
    std = intensity / float(np.sqrt(2.0 * max(speaking, 1.0)))
    share = float(np.sum(np.diff(fit.bands.edges) * np.maximum(power - fast.power, 0.0)))
    share = min(1.0, share / fit.bands.length / variance)
    shape = {"intensity_nm_per_sqrt_s": intensity}
    left = float(np.sqrt(variance))
    told = NamedCause(
        name=cause.name,
        group=(cause.name,),
        parameters={"intensity_nm_per_sqrt_s": ParameterValue(intensity, std, "N m/s^0.5")},
        evidence_nats=gain,
        false_alarm_probability=chance / SHARES["burst"],
        gain=Gain(left, left * float(np.sqrt(1.0 - share)), share, (0.0, share)),
        share_of_variance=share,
        domain="time",
    )
    return told, CauseTerm(cause.name, shape, ())


def in_time(fit: Fit) -> Fit:
    """Return the fit without a delay of the torque that was found."""
    found = fit.record.late_s != 0.0 and not fit.record.late_known
    return fit.retimed(0.0, 4) if found else fit


def late_term(fit: Fit) -> CauseTerm:
    """Return the delay of the torque as the model file writes it."""
    late = fit.record.late_s
    return CauseTerm(DELAY, {"delay_s": late}, (late,))


def late_of(
    search: Search, early: Fit, rng: np.random.Generator
) -> tuple[NamedCause, CauseTerm] | None:
    """Return the delay of the torque channel; None without one, or where the model had it."""
    fit = search.fit
    if early is fit:
        return None
    found = best_delay(fit)
    term, everything = late_term(fit), set(range(len(fit.parts)))
    gain = gain_between(hold_out(early).predict(everything), hold_out(fit).predict(everything), rng)
    first = everything - set(fit.causes())
    share = 1.0 - mean_square(fit, everything) / mean_square(early, everything)
    share *= mean_square(early, everything) / mean_square(early, first)
    late = fit.record.late_s
    told = NamedCause(
        name=term.name,
        group=(term.name,),
        parameters={
            "skew_s": ParameterValue(late, found.std_s, "s"),
            "delay_s": ParameterValue(late, None, "s"),
        },
        evidence_nats=found.evidence_nats,
        false_alarm_probability=min(1.0, found.false_alarm * search.names.all_trials),
        gain=gain,
        share_of_variance=float(np.clip(share, 0.0, 1.0)),
        domain="time",
    )
    return told, term


def _likelihood(shapes: Shapes, power: FloatArray, counts: FloatArray) -> tuple[float, Noise]:
    """Return the log likelihood of the best noise of some shapes, nats, and that noise."""
    found = shapes.fit(power, counts)
    return -0.5 * float(np.sum(counts * (np.log(found.power) + power / found.power))), found


def _is_steady(fit: Fit, walk: FloatArray, fast: FloatArray) -> bool:
    """Return whether slow noise is normal: what a wrong form leaves stands in single lines."""
    slow = np.repeat(walk > 2.0 * fast, np.diff(fit.bands.edges))
    squares = (fit.residual**2 * fit.bands.spread(1.0 / walk))[slow]
    if not len(squares):
        return True
    excess = float(np.mean(squares**2)) / float(np.mean(squares)) ** 2 - 3.0
    return excess < _UNSTEADY * float(np.sqrt(24.0 / len(squares)))


def cause_of(
    one: Named, term: CauseTerm, model: BenchModel, gain: Gain, share: float, chance: float
) -> NamedCause:
    """Return a named cause as the result states it."""
    parameters = parameter_values(cause_parameters(term, extra=model.extra_causes))
    cause = one.best.term.cause
    for other in one.group:
        for name, value in other.term.shape.items():
            unit = next(p.unit for p in other.term.cause.shape if p.name == name)
            parameters.setdefault(name, ParameterValue(value, None, unit))
    group = (cause.name, *(c.name for c in one.group))
    rivals = tuple(c.name for c in one.rivals)
    several = len(group) > 1 or bool(rivals)
    return NamedCause(
        name=cause.name,
        group=group,
        rivals=rivals,
        parameters=parameters,
        evidence_nats=one.best.evidence_nats,
        probability=one.probability,
        false_alarm_probability=chance,
        gain=gain,
        separating_experiment=cause.experiment if several else None,
        share_of_variance=share,
        domain=DOMAINS.get(cause.locked_to, cause.locked_to),
    )


def mean_square(fit: Fit, parts: set[int]) -> float:
    """Return the mean square that these parts leave, fitted in the present noise, (N m)^2."""
    moments = fit.moments(np.flatnonzero(np.isin(fit.owner, list(parts)) & fit.active))
    step = solve(moments, fit.shapes, fit.spectrum, rounds=0).step
    return float(max(moments.left(step).sum(), 1e-300)) / len(fit.record)


def shares_of(fit: Fit, variance: float) -> dict[int, float]:
    """Return the share of the baseline's residual variance that each cause explains.

    The larger of what it adds to the causes accepted before it, and of what its loss would cost,
    but no more than its own torque has beyond the baseline.
    """
    beside, everything = fit.beside(*fit.causes()), set(range(len(fit.parts)))
    so_far = everything - set(fit.causes())
    whole, last = mean_square(fit, everything), mean_square(fit, so_far)
    shares = {}
    for part in fit.causes():
        so_far = so_far | {part}
        now = mean_square(fit, so_far)
        lost = mean_square(fit, everything - {part}) - whole
        flat = fit.flat(part)
        torque = beside.unexplained(fit.coefficients[flat] @ fit.rows[flat])
        own = float(torque @ torque) / len(fit.record)
        shares[part] = float(np.clip(min(max(last - now, lost), own) / variance, 0.0, 1.0))
        last = now
    return shares


def covariances(fit: Fit) -> dict[int, FloatArray]:
    """Return the covariance of linear and shape parameters of each cause, all fitted jointly."""
    active = np.flatnonzero(fit.active)
    rows, scales, owner = [fit.rows[active]], [], []
    for index, part in enumerate(fit.parts):
        if part.term is None or is_table(part.term.cause) or not smooth_shapes(part.term):
            continue
        slopes = tangent_columns(part.term, fit.linear(index), fit.record)
        new, scale = scaled_rows(fit.bands, slopes)
        rows.append(new)
        scales.append(scale)
        owner += [index] * len(scale)
    every = np.concatenate(rows)
    weight = fit.bands.spread(1.0 / fit.spectrum.power)
    matrix = (every * weight) @ every.T
    penalty = np.concatenate([fit.penalty[active], np.zeros(len(owner))])
    matrix[np.diag_indices_from(matrix)] += penalty
    root = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.pinv(matrix * np.outer(root, root), rcond=1e-10, hermitian=True)
    inverse *= np.outer(root, root)
    tangent_scale = np.concatenate(scales) if scales else np.zeros(0)
    found = {}
    for index, part in enumerate(fit.parts):
        if part.term is None:
            continue
        flat = np.searchsorted(active, fit.flat(index))
        slope = len(active) + np.flatnonzero(np.array(owner, dtype=int) == index)
        at = np.concatenate([flat, slope]).astype(int)
        scale = np.concatenate([part.scale, tangent_scale[slope - len(active)]])
        own = inverse[np.ix_(at, at)] / np.outer(scale, scale)
        if min(part.form_scale, usual_scale(part)) > 0.0:
            # a law that is off by a share in its form is no better known in size
            error = USUAL * fit.linear(index)
            own[: len(error), : len(error)] += np.outer(error, error)
        # a shape without a slope, the time of a step, has no error: it has no row
        sloped = len(smooth_shapes(part.term)) == len(part.term.cause.shape)
        found[index] = own if sloped else own[: len(flat), : len(flat)]
    return found


def place_of(fit: Fit, index: int, share: float, chance: float) -> Unexplained:
    """Return a table or a line without a name as a place."""
    term, record = fit.term(index), fit.record
    torque = (term_columns(term, record) @ fit.linear(index))[record.valid]
    torque = torque - torque.mean()
    size = float(np.sqrt(np.mean(torque**2)))
    first, _, second = term.name.removeprefix(TABLE).partition("*")
    if term.shape:
        ((key, location),) = term.shape.items()
        half = 0.5 * resolution(key, term, record)
        extent, unit = (location - half, location + half), term.cause.shape[0].unit
        # that of a line is its amplitude
        domain, size = _LINES.get(first, first), float(np.sqrt(2.0)) * size
    else:
        axis = next(axis for axis in axes_of(record) if axis.domain == first)
        domain, unit, values = first, axis.unit, axis.values[record.valid]
        values = np.mod(values, axis.period) if axis.period else values
        pieces = [piece for piece in np.array_split(np.argsort(values), 24) if len(piece)]
        energy = np.array([float(np.mean(torque[piece] ** 2)) for piece in pieces])
        place = [float(values[piece].mean()) for piece in pieces]
        high = np.flatnonzero(energy > 0.5 * energy.max())
        location, extent = place[int(np.argmax(energy))], (place[high[0]], place[high[-1]])
    return Unexplained(
        domain=domain,
        second_domain=second or None,
        location=location,
        extent=extent,
        unit=unit,
        size_nm=size,
        share_of_variance=share,
        false_alarm_probability=chance,
    )


def rest_places(
    search: Search, variance: float, noise_variance: FloatArray | None
) -> list[Unexplained]:
    """Return bursts, and humps of the noise that hold a tenth of what is left."""
    fit = search.told
    out = []
    burst = find_burst(fit, noise_variance)
    if burst is not None and burst.chance < search.alpha * SHARES["burst"]:
        out.append(
            Unexplained(
                domain="time",
                location=0.5 * (burst.from_s + burst.to_s),
                extent=(burst.from_s, burst.to_s),
                unit="s",
                size_nm=float(np.sqrt(burst.power_nm2 * len(fit.record) / burst.samples)),
                share_of_variance=min(1.0, burst.power_nm2 / variance),
                false_alarm_probability=burst.chance / SHARES["burst"],
            )
        )
    left = float(fit.bands.power(fit.residual).sum()) / len(fit.record)
    for hump in find_humps(fit):
        if hump.power_nm2 > _HUMP_SHARE * left:
            out.append(
                Unexplained(
                    domain="frequency",
                    location=float(np.sqrt(max(hump.low_hz, 1e-9) * hump.high_hz)),
                    extent=(hump.low_hz, hump.high_hz),
                    unit="Hz",
                    size_nm=float(np.sqrt(2.0 * hump.power_nm2)),
                    share_of_variance=min(1.0, hump.power_nm2 / variance),
                )
            )
    return out


def minimum_detectable(search: Search) -> tuple[Detectable, ...]:
    """Return the amplitude of each name, N m, that would have been found with 90 %."""
    fit = search.fit
    beside = fit.beside()
    information, _ = search.names.projected(beside)
    limits: dict[str, float] = {}
    for member, matrix in zip(search.names.members, information, strict=True):
        name = member.term.name
        trials = search.names.family_trials.get(name, 1.0) * search.names.all_trials
        level = chi2_level(search.alpha * SHARES["name"] / trials, len(matrix))
        largest = float(np.max(np.diag(matrix), initial=0.0))
        if largest > 0.0:
            amplitude = (np.sqrt(level) + _POWER) / np.sqrt(largest) * np.sqrt(2.0)
            limits[name] = min(limits.get(name, np.inf), float(amplitude))
    for scan in search.scans:
        statistic, amplitude = scan_power(fit, scan)
        good = statistic > 0.0
        if not good.any():
            continue
        per_sigma = float(np.median(amplitude[good] / np.sqrt(statistic[good])))
        trials = max(2.0, scan.density)
        level = chi2_level(min(0.5, search.alpha * SHARES["line"] / trials), scan.dof)
        names = {
            "motor-order": ("ripple-harmonic", "bearing-defect", "cogging"),
            "frequency": ("structural-tone", "mains-hum"),
        }.get(scan.domain, ())
        for name in names:
            if name in search.causes:
                limits[name] = (float(np.sqrt(level)) + _POWER) * per_sigma
    return tuple(Detectable(*limit) for limit in sorted(limits.items()))


def spectra(search: Search, first: Mapping[str, FloatArray]) -> tuple[Spectrum, ...]:
    """Return amplitudes of lines along every axis, with the baseline alone and with all causes."""
    found = []
    for scan in search.scans:
        after = scan_power(search.fit, scan)[1]
        before = first.get(scan.domain, after)
        grid = scan.transform.grid
        width = max(1, -(-len(grid) // _SPECTRUM_POINTS))
        starts = np.arange(0, len(grid), width)
        higher = np.maximum(before, after)
        # a cell is placed at its largest line, so that a peak stands where it was found
        places = [int(s + np.argmax(higher[s : s + width])) for s in starts]
        found.append(
            Spectrum(
                scan.domain,
                scan.unit,
                grid[places],
                np.maximum.reduceat(before, starts),
                np.maximum.reduceat(after, starts),
            )
        )
    return tuple(found)
