"""Form error: directions in which the torque of a part may differ from its form."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.bands import LowPass
from hdbench.diagnosis.discovery.fit import Fit, Part, Products, fitted_nm
from hdbench.diagnosis.discovery.moments import inverse, quick_likelihood, solve
from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.tables import is_table
from hdbench.diagnosis.discovery.term import (
    ABOVE_NOISE,
    Term,
    at_shape,
    is_whole_share,
    moved_term,
    same_torque,
    smooth_shapes,
    term_columns,
)
from hdbench.model import Cause, catalogue, first_order, shape_bounds
from hdbench.records.trace import FloatArray

# scales of a form error relative to its part, equally likely; zero is one of them
SCALES = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)
# what a law of friction, load or time is expected to be off by: catalogues and papers differ so far
# in how it turns over (atan or tanh: a tenth; exponents 1 or 2: some hundredths)
USUAL = 0.03
# mass times acceleration is exact, the acceleration is not: its filters differ by a hundredth
_INERTIA = 0.01
# what a scale costs: it is one of six
_SCALE_PRICE = float(np.log(len(SCALES)))
# a part below this many squared standard deviations has no form error that could be seen: the
# largest scale of it is 2.3 standard deviations
STRONG = 60.0
# directions of which a part of the largest scale shows less than this are left out
_SEEN = 0.5
# slow changes of amplitude and phase: half cycles of the record
_LINE_WAVES, _OTHER_WAVES = 8, 3
# speed over which a direction of motion changes, relative to the largest
_TURN = 0.02
# delay between channels that a part may have at the largest scale, s
_DELAY_S = 0.02
# time constants of filters that make such a delay, s
_LAGS_S = (0.002, 0.006, 0.02)
# ways of the motor over which friction may build up after a reversal, rad
_REACHES_RAD = (0.01, 0.1, 1.0)
# a direction of which less than this share of the power is its own is left out
_OWN_SHARE = 0.0025
# an error is nowhere more than so many times the part, per unit of relative size: where a part
# turns over, the one behind is a pulse
_STEEPEST = 30.0
# ratios of shapes over which a slower turn is spread, each with a share of one over it: the turn of
# an arctangent goes on like one over the speed
_SPREAD = (2.5, 6.0, 15.0, 40.0)
# changes of form errors that are tried without what they could say themselves, and the share of a
# cause's torque that they must span for that
_WITHOUT, _SPANNED = 4, 0.3
# ratios at which other shapes of a family are taken
_RATIOS = (0.4, 2.5)


def _modulations(record: Record, waves: int) -> FloatArray:
    """Return slow factors that an amplitude or a phase may follow, shape (k, n_samples)."""
    motion, valid = record.motion, record.motion.valid
    n = len(record)
    place = (np.arange(n) + 0.5) / n
    # a phase that wanders has half the power at twice the frequency
    out = [np.cos(np.pi * k * place) / np.sqrt(k) for k in range(1, waves + 1)]
    speed = np.where(valid, motion.velocity_rad_s, 0.0)
    largest = float(np.abs(speed).max())
    if largest > 0.0:
        share = np.abs(speed) / largest
        if float(np.std(share[valid])) > _TURN:
            centred = (share - share[valid].mean()) / share[valid].std()
            out += [centred, 0.5 * (centred**2 - 1.0)]
        if speed[valid].min() < -_TURN * largest and speed[valid].max() > _TURN * largest:
            out.append(np.tanh(speed / (_TURN * largest)))
    turn = np.where(valid, motion.output_angle_rad, 0.0)
    if float(np.ptp(turn[valid])) > 1.0:
        out += [f(k * turn) / k for k in (1.0, 2.0) for f in (np.cos, np.sin)]
    load = motion.load_smooth_nm
    if load is not None:
        held = np.where(valid & np.isfinite(load), load, 0.0)
        if float(np.std(held[valid])) > 0.0:
            out.append((held - held[valid].mean()) / held[valid].std())
    return np.stack(out)


def _directions(
    record: Record, columns: FloatArray, linear: FloatArray, line: bool, term: Term | None
) -> FloatArray:
    """Return directions of form error of a part, N m per unit of relative size, a row each.

    Those of one kind share its size: how many there are says nothing of how large the error is.
    """
    torque = columns @ linear
    waves = [torque]
    if line:
        turned = np.zeros_like(torque)
        for c in range(0, columns.shape[1] - 1, 2):
            turned += linear[c] * columns[:, c + 1] - linear[c + 1] * columns[:, c]
        waves.append(turned)
    count = _LINE_WAVES if line else _OTHER_WAVES
    slow = record.remembered(("modulations", count), lambda: _modulations(record, count))
    kinds = [[b * wave for b in slow for wave in waves]]
    if not line:
        kinds.append(_delayed(record, torque))
        if term is not None:
            kinds.append(_built_up(record, torque, term))
            kinds.append(_towards(record, torque, _other_shapes(term, record)))
            kinds.append(_spread(record, torque, term, linear))
        kinds = [_beyond_plain(record, torque, kind) for kind in kinds]
    if term is not None:
        kinds.append(_towards(record, torque, _other_forms(term, record)))
    rows = [row / np.sqrt(len(kind)) for kind in kinds for row in kind]
    return np.stack(rows) if rows else np.zeros((0, len(torque)))


def _towards(record: Record, torque: FloatArray, others: list[Term]) -> list[FloatArray]:
    """Return what leads from a torque to the nearest one of each of some other terms."""
    out = []
    for other in others:
        columns = term_columns(other, record)
        if np.any(columns):
            nearest = columns @ np.linalg.lstsq(columns, torque, rcond=None)[0]
            out.append((nearest - torque) / SCALES[-1])
    return out


def _spread(record: Record, torque: FloatArray, term: Term, linear: FloatArray) -> list[FloatArray]:
    """Return what leads to a term with many shapes at once: it turns over more slowly."""
    out = []
    # a play or a limit does not turn over
    for name in () if is_whole_share(term.cause) else smooth_shapes(term):
        row = np.zeros_like(torque)
        for ratio in _SPREAD:
            other = at_shape(term, name, term.shape[name] * ratio, record)
            if other is not None:
                row += (term_columns(other, record) @ linear - torque) / ratio
        out.append(row / SCALES[-1])
    return out


def _other_forms(term: Term, record: Record) -> list[Term]:
    """Return other forms of a term's torque, of which a fit has only one."""
    return [
        Term(cause, shape)
        for cause in catalogue().values()
        if cause.name != term.name
        and same_torque(cause, term.cause)
        and cause.applicable(record.motion) is None
        for shape in _typical_shapes(cause, record)
    ]


def _typical_shapes(cause: Cause, record: Record) -> list[dict[str, float]]:
    """Return shapes at both ends and in the middle of the first one's domain; none without one."""
    if not cause.shape:
        return [{}]
    rest = {p.name: p.default for p in cause.shape[1:] if p.default is not None}
    return [
        {cause.shape[0].name: float(low * (high / low) ** share), **rest}
        for low, high in shape_bounds(cause, record.motion)[cause.shape[0].name][:1]
        for share in (0.0, 0.5, 1.0)
    ]


def _beyond_plain(
    record: Record, torque: FloatArray, directions: list[FloatArray]
) -> list[FloatArray]:
    """Return what directions hold beyond plain laws of motion, time and place.

    What has a plain form is a cause of its own, and no error of another one's form.
    """
    if not directions:
        return []
    basis = record.remembered("plain laws", lambda: _plain_laws(record))
    most = _STEEPEST * float(np.sqrt(np.mean(torque**2)))
    held = np.where(record.motion.valid, np.clip(np.stack(directions), -most, most), 0.0)
    left = held - (held @ basis.T) @ basis
    before, after = (np.einsum("kn,kn->k", one, one) for one in (held, left))
    return [*left[after > _OWN_SHARE * before]]


def _plain_laws(record: Record) -> FloatArray:
    """Return an orthonormal basis of the plain laws of motion, time and place, a row each."""
    motion, valid = record.motion, record.motion.valid
    speed = np.where(valid, motion.velocity_rad_s, 0.0)
    largest = max(float(np.abs(speed).max()), 1e-12)
    share = speed / largest
    turn = np.where(valid, motion.output_angle_rad, 0.0)
    plain = [np.ones(len(record)), share, np.abs(share), share * np.abs(share)]
    plain += [np.tanh(share / _TURN), np.linspace(-1.0, 1.0, len(record))]
    plain.append(np.where(np.isfinite(motion.acceleration_rad_s2), motion.acceleration_rad_s2, 0.0))
    if float(np.ptp(turn[valid])) > 1.0:
        plain += [f(k * turn) for k in (1.0, 2.0, 3.0) for f in (np.cos, np.sin)]
    columns = np.where(valid[:, None], np.column_stack(plain), 0.0)
    size = np.sqrt(np.mean(columns**2, axis=0))
    columns = columns[:, size > 0.0] / size[size > 0.0]
    value, vector = np.linalg.eigh(columns.T @ columns / len(record))
    # a speed that hardly changes has ripple and noise only
    kept = value > _TURN**2
    return np.asarray((vector[:, kept] / np.sqrt(value[kept] * len(record))).T @ columns.T)


def _delayed(record: Record, torque: FloatArray) -> list[FloatArray]:
    """Return what leads to a torque behind, and ahead of, the filters of a channel."""
    from scipy.signal import lfilter

    out = []
    for lag in _LAGS_S:
        kept = float(np.exp(-record.period_s / lag))
        for way in (1, -1):
            behind = lfilter((1.0 - kept,), (1.0, -kept), torque[::way])[::way]
            out.append(_DELAY_S / lag / SCALES[-1] * (behind - torque))
    return out


def _built_up(record: Record, torque: FloatArray, term: Term) -> list[FloatArray]:
    """Return what leads to a dry friction that builds up over the way moved after a reversal.

    Until that way is gone, friction is anything up to its size. A torque in proportion to the speed
    is zero at a reversal anyway.
    """
    if term.cause.locked_to != "velocity" or term.cause.linear[0].unit == "N m s/rad":
        return []
    way = np.abs(np.diff(record.motion.angle_rad, prepend=record.motion.angle_rad[:1]))
    way = np.where(np.isfinite(way), way, 0.0)
    lefts = [np.exp(-way / reach) for reach in _REACHES_RAD]
    return [(first_order(left, (1.0 - left) * torque) - torque) / USUAL for left in lefts]


def _other_shapes(term: Term, record: Record) -> list[Term]:
    """Return the term at other shapes of its family."""
    out = []
    if "step_time_s" in term.shape:
        for move in (-0.01, -0.003, 0.003, 0.01):
            time = term.shape["step_time_s"] + move * record.span_s
            out.append(replace(term, shape={**term.shape, "step_time_s": time}))
    for name in smooth_shapes(term):
        value = term.shape[name]
        for ratio in _RATIOS:
            other = at_shape(term, name, value * ratio, record)
            other = other or moved_term(term, {name: value * ratio - value}, record)
            if other.shape != term.shape:
                out.append(other)
    return out


def form_rows(fit: Fit, part: int) -> tuple[FloatArray, Products]:
    """Return the leading directions of form error of a part, per unit of the form scale.

    As rows and their products. Directions are orthogonal in the noise of the fit; those that the
    largest scale would not show are left out.
    """
    held = fit.parts[part]
    record = fit.record
    if held.name == CHANNEL:
        return _leading(fit, _channel_rows(fit))
    if held.term is not None:
        columns, linear = term_columns(held.term, record), fit.linear(part)
        line = columns.shape[1] % 2 == 0 and held.term.cause.locked_to in ("motor", "clock")
        directions = _directions(record, columns, linear, line, held.term)
    elif held.name == FIXED:
        motion = record.motion
        torque = np.where(motion.valid, motion.inertia_nm_s2 * motion.acceleration_rad_s2, 0.0)
        torque = np.where(np.isfinite(torque), torque, 0.0)
        directions = _directions(record, torque[:, None], np.ones(1), False, None)
    elif not held.name.startswith("ripple"):
        directions = np.zeros((0, len(record)))
    else:
        places = [i for i, n in enumerate(record.names) if n.startswith(f"{held.name}:")]
        columns, linear = record.columns[:, places], fit.linear(part)
        directions = _directions(record, columns, linear, True, None)
        order = float(held.name.partition(":")[2])
        fast = _fast_angle(record)
        cosine, sine = columns[:, ::2], columns[:, 1::2]
        turned = sine @ linear[::2] - cosine @ linear[1::2]
        directions = np.vstack([directions, order * fast * turned / SCALES[-1]])
    return _leading(fit, fit.bands.transform(directions.T))


def _channel_rows(fit: Fit) -> FloatArray:
    """Return what another low-pass would make of the torque, per unit of relative size."""
    ahead = fitted_nm(fit) + np.concatenate([one.ahead_nm for one in fit.pieces])
    column, rows = ahead[:, None], []
    held = fit.bands.transform(column)[0]
    for share, change in _CHANGES:
        rows.append((fit.bands.behind(change).transform(column)[0] - held) / share)
    return np.stack(rows)


def _leading(fit: Fit, rows: FloatArray) -> tuple[FloatArray, Products]:
    """Return the directions among some rows that the largest scale shows, and their products."""
    beside = fit.beside()
    products = beside.products(rows)
    value, vector = np.linalg.eigh(beside.projected(products)[0])
    seen = vector[:, value * SCALES[-1] ** 2 > _SEEN]
    return seen.T @ rows, products.mixed(seen)


def formed_share(fit: Fit, part: int) -> float:
    """Return the share of a cause's torque, in the noise of the fit, that has the cause's form."""
    own, weight = fit.owner == part, fit.bands.spread(1.0 / fit.spectrum.power)
    plain, error = (
        float(weight @ (fit.coefficients[some] @ fit.rows[some]) ** 2)
        for some in (own & ~fit.form, own & fit.form)
    )
    return plain / max(plain + error, 1e-300)


FIXED = "expected-torque"
# low-pass of the torque channel: its corner and its order are off by a share
CHANNEL = "torque-channel"
# share by which a corner and a damping are changed for a slope
_LESS = 0.01
# other low-passes, each with its size as a form error: a lower corner, a lower damping, a higher
# order, and a filter of samples, which bends frequencies, for one ahead of the sampling or
# the reverse
_CHANGES: tuple[tuple[float, Callable[[LowPass], LowPass]], ...] = (
    (_LESS, lambda low_pass: replace(low_pass, corner=(1.0 - _LESS) * low_pass.corner)),
    (_LESS, lambda low_pass: replace(low_pass, damping=(1.0 - _LESS) * low_pass.damping)),
    (SCALES[-1], lambda low_pass: replace(low_pass, order=low_pass.order + 1)),
    (USUAL, lambda low_pass: replace(low_pass, analog=not low_pass.analog)),
)


def _fast_angle(record: Record) -> FloatArray:
    """Return the fast part of the angle, rad: counting steps and noise of the encoder."""
    from scipy.ndimage import uniform_filter1d

    known = record.motion.valid
    angle = np.where(known, record.motion.angle_rad, 0.0)
    smooth = uniform_filter1d(uniform_filter1d(angle, 9), 9)
    fast = np.where(known, angle - smooth, 0.0)
    spread = float(np.median(np.abs(fast))) / 0.6745
    return np.where(np.abs(fast) < 5.0 * spread, fast, 0.0)


def attach_forms(fit: Fit, *, idle: bool = False) -> None:
    """Give every strong part that has none its directions of form error, at its usual scale.

    Strong is what a part has of its own: one that others can take the place of has no form. Those
    of scale zero, that of a line as a rule, only where `idle` ones are asked for.
    """
    held = {part.name for part in fit.parts}
    if fit.record.motion.inertia_nm_s2 > 0.0 and _accelerates(fit.record) and FIXED not in held:
        fit.parts.append(Part(FIXED, None, np.zeros(0)))
    if CHANNEL not in held and np.any(fit.bands.passed < 1.0):
        fit.parts.append(Part(CHANNEL, None, np.zeros(0)))
    covariance, before = inverse(fit.information), len(fit.rows)
    for index, part in enumerate(fit.parts):
        if not (idle or part.form_scale or usual_scale(part)):
            continue
        # a table may have any form already
        table = part.term is not None and is_table(part.term.cause)
        if table or bool(np.any((fit.owner == index) & fit.form)):
            continue
        if part.name not in (FIXED, CHANNEL) and own_statistic(fit, index, covariance) < STRONG:
            continue
        rows, products = form_rows(fit, index)
        if len(rows):
            fit.add_form(index, rows, products)
            part.form_scale = part.form_scale or usual_scale(part)
    if len(fit.rows) > before:
        fit.settle(1)


def renew_channel(fit: Fit) -> None:
    """Let the form error of the torque channel be about what is explained by now."""
    for index, part in enumerate(fit.parts):
        if part.name == CHANNEL:
            fit.keep(fit.owner != index)
            fit.add_form(index, *form_rows(fit, index))
            fit.settle(1)


def own_statistic(fit: Fit, part: int, covariance: FloatArray) -> float:
    """Return the squared size of a part in standard deviations, form errors and all others free."""
    flat = fit.flat(part)
    own = np.linalg.pinv(covariance[np.ix_(flat, flat)], hermitian=True)
    return float(fit.coefficients[flat] @ own @ fit.coefficients[flat])


def _accelerates(record: Record) -> bool:
    motion = record.motion
    largest = float(np.abs(motion.acceleration_rad_s2[record.valid]).max())
    return largest > ABOVE_NOISE * motion.acceleration_noise_rad_s2


@dataclass(frozen=True, slots=True)
class FormMove:
    """A change of form errors.

    Parameters
    ----------
    gain_nats : float
        Gain in evidence.
    scales : dict of int to float
        New form scales by part.
    needless : tuple of int
        Causes that go because the form error says the same.
    """

    gain_nats: float
    scales: dict[int, float]
    needless: tuple[int, ...] = ()


def best_form_move(fit: Fit, parts: Container[int] | None = None) -> FormMove | None:
    """Return the change of form errors that gains most; None where there are none.

    Only those of `parts` where these are given, and then all causes stay.

    Notes
    -----
    Tried are the scales of each part alone and of all lines together, since an angle that is not
    quite the shaft's spoils all of them. Satellites of a line that a larger form error explains
    are taken out at once: one by one each of them is needed as long as the others stand.
    """
    present = [part.form_scale for part in fit.parts]

    def at(scales: Mapping[int, float]) -> tuple[NDArray[np.bool_], FloatArray, float]:
        """Return the active rows, the penalty and the cost of some scales."""
        for index, scale in scales.items():
            fit.parts[index].form_scale = scale
        found = fit.active, fit.penalty, form_cost(fit)
        for index in scales:
            fit.parts[index].form_scale = present[index]
        return found

    def value(scales: Mapping[int, float], needless: Sequence[int] = ()) -> float:
        active, penalty, cost = at(scales)
        kept = np.flatnonzero(active & ~np.isin(fit.owner, needless))
        cost -= sum(fit.parts[part].cost_nats for part in needless)
        tried = fit.moments(kept, penalty)
        return solve(tried, fit.shapes, fit.spectrum, rounds=1).likelihood - cost

    def quick(scales: Mapping[int, float]) -> float:
        active, penalty, cost = at(scales)
        return quick_likelihood(weighted, right, penalty, active) - cost

    held = sorted(set(fit.owner[fit.form].tolist()))
    if parts is not None:
        held = [part for part in held if part in parts]
    moves = [{index: scale} for index in held for scale in _neighbours(present[index])]
    lines = [i for i in held if usual_scale(fit.parts[i]) == 0.0]
    if len(lines) > 1:
        moves += [dict.fromkeys(lines, scale) for scale in SCALES[1:]]
    if not moves:
        return None
    base = value({})
    weighted, right = fit.weighted(), (1.0 / fit.spectrum.power) @ fit.against
    right += fit.penalty * fit.expected
    moves.sort(key=quick, reverse=True)
    tried = [FormMove(value(scales) - base, scales) for scales in moves[:_WITHOUT]]
    for move in tuple(tried) if parts is None else ():
        named = [part for part in fit.causes() if not is_table(fit.term(part).cause)]
        satellites = _spanned(fit, tuple(move.scales), named)
        for count in range(1, len(satellites) + 1):
            gain = value(move.scales, satellites[:count]) - base
            tried.append(FormMove(gain, move.scales, tuple(satellites[:count])))
    return max(tried, key=lambda move: move.gain_nats)


def _spanned(fit: Fit, parts: tuple[int, ...], causes: Iterable[int]) -> list[int]:
    """Return the causes whose torque the form errors of some parts can say, the nearest first."""
    gram = fit.weighted()
    rows = np.flatnonzero(np.isin(fit.owner, parts) & fit.form)
    own = gram[np.ix_(rows, rows)] + np.eye(len(rows))
    shares = {}
    for cause in causes:
        if cause in parts:
            continue
        flat = fit.flat(cause)
        torque = fit.coefficients[flat]
        size = float(torque @ gram[np.ix_(flat, flat)] @ torque)
        cross = gram[np.ix_(rows, flat)] @ torque
        shares[cause] = float(cross @ np.linalg.solve(own, cross)) / max(size, 1e-300)
    near = [cause for cause, share in shares.items() if share > _SPANNED]
    return sorted(near, key=lambda cause: -shares[cause])


def _neighbours(scale: float) -> tuple[float, ...]:
    """Return the scales that are tried from here: the next ones, and from zero two of them."""
    if scale == 0.0:
        return SCALES[2], SCALES[4]
    if scale == USUAL:
        return SCALES[0], SCALES[2], SCALES[4]
    at = SCALES.index(scale)
    return SCALES[at - 1 : at] + SCALES[at + 1 : at + 2]


def usual_scale(part: Part) -> float:
    """Return the scale that a form error has beforehand: laws are never exact, lines often are."""
    if part.term is None:
        return {FIXED: _INERTIA, CHANNEL: USUAL}.get(part.name, 0.0)
    return 0.0 if part.term.cause.locked_to in ("motor", "clock") else USUAL


def form_cost(fit: Fit) -> float:
    """Return what the scales of all form errors cost, nats; a scale that lines share costs once."""
    laws, lines = 0, set()
    for index in set(fit.owner[fit.form].tolist()):
        part = fit.parts[index]
        if usual_scale(part) == 0.0:
            lines.add(part.form_scale)
        else:
            laws += part.form_scale != usual_scale(part)
    return _SCALE_PRICE * (laws + len(lines - {0.0}))
