"""A whole fit with further causes: form errors, shapes, sizes, and the torque that it simulates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from hdbench.diagnosis.discovery.fit import Fit, fitted_nm, scaled_rows
from hdbench.diagnosis.discovery.form import (
    attach_forms,
    best_form_move,
    form_cost,
    own_statistic,
    usual_scale,
)
from hdbench.diagnosis.discovery.moments import inverse
from hdbench.diagnosis.discovery.record import SAMPLED, with_simulated
from hdbench.diagnosis.discovery.refine import candidate_of
from hdbench.diagnosis.discovery.tables import is_table
from hdbench.diagnosis.discovery.term import (
    Term,
    at_shape,
    free_shapes,
    is_whole_share,
    moved_term,
    smooth_shapes,
    tangent_columns,
    term_columns,
)
from hdbench.diagnosis.evidence import RIVAL_NATS
from hdbench.model import Cause
from hdbench.model.causes.kinematic import TRANSMISSION_ERROR
from hdbench.records.trace import FloatArray

# steps over all shapes, shorter ones where a whole one gains nothing, and the gain that ends them
_STEPS, _LENGTHS, _STEP_NATS = 6, (1.0, 0.3), 0.1
# ratios by which a shape is moved where its form errors are made anew, up and down
_COARSE, _FINE = (2.5, 0.4), (1.25, 0.8)
# rounds, at most, in which what acts on the whole signal follows it
_RENEWED = 12
# way of the motor over which a slope is formed where the angle has no error
_LEAST_WAY_RAD = 1e-5
# a size that is so many standard deviations outside its limits is none that a cause can have: 95 %
_POSSIBLE_STDS = 2.0
# nor one of so many times the torque
_LARGEST = 2.0
# a cause, or a change of form errors, that has less evidence than this is none, nats
LEAST_NATS = 1.0


def value_of(fit: Fit) -> float:
    """Return the log likelihood of a fit less what the scales of its form errors cost."""
    return fit.likelihood - form_cost(fit)


def joined(fit: Fit, terms: Sequence[Term], *, hidden: bool = False) -> Fit:
    """Return a copy of a fit with further terms and their form errors.

    It is settled from the present noise and from one that does not rise: a large effect whose
    details are not exact looks small in a noise that has taken those details in. Slow noise, and
    any noise that may still have a `hidden` effect in it, takes the form errors in as well: there
    they come first.
    """
    new = fit.copy()
    for term in terms:
        new.add_term(term)
    flat = new.flat_view()
    new.settle(2)
    if flat is not None:
        table = any(is_table(term.cause) for term in terms)
        if (hidden or fit.shapes.with_slow) and not table:
            attach_forms(flat)
        flat.settle(2)
        new = max(new, flat, key=value_of)
    attach_forms(new)
    new.rescale_forms()
    new.settle(3)
    return new


def best_joined(
    fit: Fit, terms: tuple[Term, ...], *, hidden: bool = False, wide: bool = False
) -> tuple[Fit, tuple[Term, ...]]:
    """Return a fit with further terms, their form errors and their shapes refined in it.

    `wide`: over their whole domains.
    """
    new = joined(fit, terms, hidden=hidden)
    places = list(range(len(new.parts) - len(terms), len(new.parts)))
    best = best_formed(new, len(terms))
    best = best_formed(reshaped(best, places, wide=wide), len(terms))
    return best, tuple(best.term(place) for place in places)


def reshaped(fit: Fit, parts: Sequence[int], *, wide: bool = False) -> Fit:
    """Return a fit with the shapes of some causes refined; the same where none gains."""
    return _formed_shapes(stepped(fit, parts), parts, wide)


def stepped(fit: Fit, parts: Sequence[int]) -> Fit:
    """Return a fit after steps of Gauss and Newton over the shapes of some causes at once."""
    for _ in range(_STEPS):
        ahead = _ahead(fit, parts)
        if ahead is None:
            break
        done = value_of(ahead) - value_of(fit) < _STEP_NATS
        fit = ahead
        if done:
            break
    return fit


def _ahead(fit: Fit, parts: Sequence[int]) -> Fit | None:
    """Return the fit after one step of Gauss and Newton over shapes; None where none gains.

    A slope is held against the form errors, which have a prior: without them a shape would follow
    what is an error of the form.
    """
    rows: list[FloatArray] = []
    slopes: list[tuple[int, str, float]] = []
    for part in parts:
        term = fit.term(part)
        names = free_shapes(term)
        if names:
            own, scale = scaled_rows(fit.bands, tangent_columns(term, fit.linear(part), fit.record))
            rows.append(own)
            slopes += [(part, name, size) for name, size in zip(names, scale.tolist(), strict=True)]
    if not slopes:
        return None
    matrix, right = fit.beside().project(np.concatenate(rows))
    solution = np.linalg.lstsq(matrix + 1e-9 * np.diag(np.diag(matrix)), right, rcond=1e-10)[0]
    if 0.5 * float(solution @ right) < _STEP_NATS:
        return None
    for length in _LENGTHS:
        moves: dict[int, dict[str, float]] = {}
        for (part, name, size), step in zip(slopes, solution.tolist(), strict=True):
            moves.setdefault(part, {})[name] = length * step / size
        moved = {k: moved_term(fit.term(k), move, fit.record) for k, move in moves.items()}
        moved = {k: term for k, term in moved.items() if term.shape != fit.term(k).shape}
        new = _at_shapes(fit, moved) if moved else fit
        if value_of(new) > value_of(fit):
            return new
    return None


def _formed_shapes(fit: Fit, parts: Sequence[int], wide: bool) -> Fit:
    """Return a fit in which laws have the shapes about which form errors are likeliest.

    A form error moves with the shape, which no slope shows; `wide` ones may be anywhere.
    """
    for part in parts:
        if not np.any(fit.form & (fit.owner == part)) or not usual_scale(fit.parts[part]):
            continue
        for name in smooth_shapes(fit.term(part)):
            if wide:
                whole = (_along_shape(fit, part, name, ratio) for ratio in _COARSE)
                fit = max(chain((fit,), *whole), key=value_of)
            for ratio in (*_COARSE, *_FINE):
                for new in _along_shape(fit, part, name, ratio):
                    if value_of(new) < value_of(fit) + _STEP_NATS:
                        break
                    fit = new
    return fit


def _along_shape(fit: Fit, part: int, name: str, ratio: float) -> Iterator[Fit]:
    """Yield the fit with one shape of a cause at powers of a ratio of it, to the domain's end."""
    term, value = fit.term(part), fit.term(part).shape[name] * ratio
    while moved := at_shape(term, name, value, fit.record):
        yield _at_shapes(fit, {part: moved})
        value *= ratio


def _at_shapes(fit: Fit, terms: Mapping[int, Term]) -> Fit:
    """Return a fit with causes at other shapes, their form errors made anew."""
    new = fit.copy()
    # the directions of a form error are those about the shape
    new.keep(~(new.form & np.isin(new.owner, list(terms))))
    for part, term in terms.items():
        new.reshape(part, term, shared=False)
    new.settle(1)
    attach_forms(new)
    return new


def best_formed(fit: Fit, last: int) -> Fit:
    """Return a fit whose last causes, laws among them, have the likeliest form errors."""
    places = range(len(fit.parts) - last, len(fit.parts))
    laws = [part for part in places if usual_scale(fit.parts[part]) > 0.0]
    for _ in laws:
        move = best_form_move(fit, laws)
        if move is None or move.gain_nats < LEAST_NATS:
            break
        for part, scale in move.scales.items():
            fit.parts[part].form_scale = scale
        fit.settle(2)
    return fit


def all_possible(fit: Fit, last: int) -> bool:
    """Return whether the last causes of a fit have sizes and parameters that can be."""
    places = range(len(fit.parts) - last, len(fit.parts))
    return all(
        is_within(fit, part)
        and candidate_of(fit.beside(part), fit.record, fit.term(part), 1.0, 1.0).statistic > 0.0
        for part in places
    )


def is_within(fit: Fit, part: int) -> bool:
    """Return whether a part is no larger than parts of a torque are.

    Two that nearly cancel each other, as a law of speed and a zero do, explain nothing.
    """
    return fit.size_nm(part) <= _LARGEST * float(np.sqrt(np.mean(fit.measured**2)))


def sized(fit: Fit) -> tuple[Fit, list[int]]:
    """Return the fit in which names have their sizes, and the place of each of its parts in `fit`.

    That is the one without tables where a table takes in a name.
    """
    view, places, _ = _sized(fit)
    return view, places


def impossible_parts(fit: Fit) -> set[int]:
    """Return the causes whose size beside all others is none that they can have."""
    view, places, unsized = _sized(fit)
    if view is fit:
        return unsized
    return {places[part] for part in _unsized(view)} | unsized & set(fit.tables())


def _sized(fit: Fit) -> tuple[Fit, list[int], set[int]]:
    """Return what `sized` does, and the causes without a size in the whole fit."""
    every, tables, unsized = list(range(len(fit.parts))), fit.tables(), _unsized(fit)
    if not tables or not unsized - set(tables):
        return fit, every, unsized
    return fit.without(*tables), [part for part in every if part not in tables], unsized


def _unsized(fit: Fit) -> set[int]:
    """Return the causes of a fit whose size is outside of its limits, may be zero, or is too large.

    Where it may be zero, the form error alone explains the torque. A share that is 1 where the
    cause is what it says has no limits: how far it is off is an error of its form.
    """
    covariance = inverse(fit.information)
    std = np.sqrt(np.diag(covariance))
    found = set()
    for part in fit.causes():
        slack = _POSSIBLE_STDS * std[fit.flat(part)] / fit.parts[part].scale
        limits = zip(fit.term(part).cause.linear, fit.linear(part), slack, strict=True)
        inside = all(p.lower - s <= value <= p.upper + s for p, value, s in limits)
        inside |= is_whole_share(fit.term(part).cause)
        sure = own_statistic(fit, part, covariance) > 2.0 * RIVAL_NATS
        if not inside or not sure or not is_within(fit, part):
            found.add(part)
    return found


def _turns_with_motor(cause: Cause) -> bool:
    """Return whether a cause is a part of the signal that follows the motor angle."""
    return cause.locked_to == "motor" and not cause.whole_signal


def slope_and_error(fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Return the slope of the fitted torque over the motor angle, N m/rad, and its error, rad.

    Where the recorded angle has an error the slope is over the whole of it: the error times the
    slope is then the torque of any error, large or small.
    """
    record = fit.record
    error, slope = np.zeros(len(record)), np.zeros(len(record))
    # its columns are the error where the torque falls by 1 N m/rad
    slopes = -np.ones(len(record))
    falling = replace(record.motion, ripple_slope_nm_per_rad=slopes, inertia_nm_s2=0.0)
    for index, part in enumerate(fit.parts):
        if part.term is not None and part.name == TRANSMISSION_ERROR:
            errors = term_columns(part.term, replace(record, motion=falling))
            error += errors @ fit.linear(index)
    for index, part in enumerate(fit.parts):
        kind, _, order = part.name.partition(":")
        if part.term is None and kind in ("ripple", SAMPLED):
            k, linear = float(order), fit.linear(index)
            places = [i for i, n in enumerate(record.names) if n.startswith(f"{part.name}:")]
            wave, half = record.columns[:, places], 0.5 * k * error
            torque = wave @ linear
            turned = wave[:, ::2] @ linear[1::2] - wave[:, 1::2] @ linear[::2]
            slope += k * torque * np.sin(half) * np.sinc(half / np.pi)
            slope += k * turned * np.sinc(2.0 * half / np.pi)
        elif part.term is not None and _turns_with_motor(part.term.cause):
            way = np.where(np.abs(error) > _LEAST_WAY_RAD, error, _LEAST_WAY_RAD)
            motion = replace(record.motion, angle_rad=record.motion.angle_rad - way)
            moved = term_columns(part.term, replace(record, motion=motion))
            here = term_columns(part.term, record)
            slope += (here - moved) @ fit.linear(index) / way
    return slope, error


def on_simulated(fit: Fit) -> Fit:
    """Return a fit whose record holds the torque that the fit simulates."""
    fit.record = with_simulated(fit.record, fitted_nm(fit, whole=False), *slope_and_error(fit))
    return fit


def renew(fit: Fit) -> None:
    """Let what acts on the whole signal act on the signal as it is fitted now."""
    for _ in range(_RENEWED):
        on_simulated(fit)
        before = fit.likelihood
        for part in fit.causes():
            term = fit.term(part)
            if term.cause.whole_signal:
                # what it can be follows the signal, too
                fit.reshape(part, moved_term(term, dict.fromkeys(term.shape, 0.0), fit.record))
                fit.settle(1)
        if fit.likelihood < before + LEAST_NATS:
            return
