"""Form error: directions in which the torque of a part may differ from its form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdbench.diagnosis.discovery.fit import Fit, Part
from hdbench.diagnosis.discovery.moments import solve
from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.term import Term, moved_term, smooth_shapes, term_columns
from hdbench.model import shape_bounds
from hdbench.records.trace import FloatArray

__all__ = ["attach_forms", "best_form_move", "form_rows"]

# scales of a form error relative to its part, equally likely; zero is one of them
SCALES = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)
# what a law of friction, load or time is expected to be off by: catalogues and papers differ so far
# in how it turns over (atan or tanh: a tenth; exponents 1 or 2: some hundredths)
USUAL = 0.03
# what a scale costs: it is one of six
_SCALE_PRICE = float(np.log(len(SCALES)))
# a part below this many squared standard deviations has no form error that could be seen: a
# hundredth of it in amplitude is a tenth of a standard deviation
STRONG = 200.0
# directions of which a part of the largest scale shows less than this are left out
_SEEN = 0.5
_MOST = 12
# slow changes of amplitude and phase: half cycles of the record
_LINE_WAVES, _OTHER_WAVES = 8, 3
# speed over which a direction of motion changes, relative to the largest
_TURN = 0.02
# delay between channels that a part may have at the largest scale, s
_DELAY_S = 0.02
# an acceleration that never leaves its own noise by this much carries no torque
_ABOVE_NOISE = 10.0
# ratios at which other shapes of a family are taken
_RATIOS = (0.4, 2.5)


def _modulations(record: Record, waves: int) -> list[FloatArray]:
    """Return slow factors that an amplitude or a phase may follow."""
    motion, valid = record.motion, record.valid
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
    return out


def _directions(
    record: Record, columns: FloatArray, linear: FloatArray, line: bool, term: Term | None
) -> FloatArray:
    """Return directions of form error of a part, N m per unit of relative size."""
    torque = columns @ linear
    waves = [torque]
    if line:
        turned = np.zeros_like(torque)
        for c in range(0, columns.shape[1] - 1, 2):
            turned += linear[c] * columns[:, c + 1] - linear[c + 1] * columns[:, c]
        waves.append(turned)
    out = [
        b * wave
        for b in _modulations(record, _LINE_WAVES if line else _OTHER_WAVES)
        for wave in waves
    ]
    rate = np.gradient(torque, record.motion.time_s)
    size = float(np.sqrt(np.mean(torque**2)))
    if not line:
        out.append(_DELAY_S / SCALES[-1] * rate)
        curve = np.gradient(rate, record.motion.time_s)
        out.append((_DELAY_S**2) / SCALES[-1] * curve)
    if term is not None and not line:
        for moved in _other_shapes(term, record):
            other = term_columns(moved, record)
            power = float(np.sum(other**2))
            if power > 0.0:
                other = other @ np.linalg.lstsq(other, torque, rcond=None)[0]
                out.append(other - torque)
    kept = [np.clip(c, -30.0 * size, 30.0 * size) for c in out if np.any(c)]
    return np.column_stack(kept) if kept else np.zeros((len(torque), 0))


def _other_shapes(term: Term, record: Record) -> list[Term]:
    """Return the term at other shapes of its family."""
    out = []
    if "step_time_s" in term.shape:
        for move in (-0.01, -0.003, 0.003, 0.01):
            time = term.shape["step_time_s"] + move * record.span_s
            out.append(replace(term, shape={**term.shape, "step_time_s": time}))
    bounds = shape_bounds(term.cause, record.motion)
    for name in smooth_shapes(term):
        value = term.shape[name]
        for ratio in _RATIOS:
            target = value * ratio
            if any(a <= target <= b for a, b in bounds.get(name, ())):
                out.append(replace(term, shape={**term.shape, name: target}))
            else:
                nearer = moved_term(term, {name: target - value}, record)
                if nearer.shape != term.shape:
                    out.append(nearer)
    return out


def form_rows(fit: Fit, part: int) -> FloatArray:
    """Return the leading directions of form error of a part, rows per unit of the form scale.

    Directions are orthogonal in the noise of the fit; those that the largest scale would not show
    are left out.
    """
    held = fit.parts[part]
    record = fit.record
    if held.term is not None:
        columns, linear = term_columns(held.term, record), fit.linear(part)
        line = columns.shape[1] % 2 == 0 and held.term.cause.locked_to in ("motor", "clock")
        directions = _directions(record, columns, linear, line, held.term)
    elif held.name == FIXED:
        motion = record.motion
        torque = np.where(record.valid, motion.inertia_nm_s2 * motion.acceleration_rad_s2, 0.0)
        torque = np.where(np.isfinite(torque), torque, 0.0)
        directions = _directions(record, torque[:, None], np.ones(1), False, None)
    else:
        places = [i for i, n in enumerate(record.names) if n.startswith(f"{held.name}:")]
        if not held.name.startswith("ripple"):
            return np.zeros((0, fit.bands.size))
        columns, linear = record.columns[:, places], fit.linear(part)
        directions = _directions(record, columns, linear, True, None)
        order = float(held.name.partition(":")[2])
        fast = _fast_angle(record)
        turned = linear[0] * columns[:, 1] - linear[1] * columns[:, 0]
        directions = np.column_stack([directions, order * fast * turned / SCALES[-1]])
    if not directions.shape[1]:
        return np.zeros((0, fit.bands.size))
    rows = fit.bands.transform(directions)
    beside = fit.beside()
    matrix, _ = beside.project(rows)
    value, vector = np.linalg.eigh(matrix)
    seen = np.flatnonzero(value * SCALES[-1] ** 2 > _SEEN)[::-1][:_MOST]
    return np.asarray(vector[:, seen].T @ rows)


FIXED = "expected-torque"


def _fast_angle(record: Record) -> FloatArray:
    """Return the fast part of the angle, rad: counting steps and noise of the encoder."""
    from scipy.ndimage import uniform_filter1d

    angle = np.where(record.valid, record.motion.angle_rad, 0.0)
    smooth = uniform_filter1d(uniform_filter1d(angle, 9), 9)
    fast = np.where(record.valid, angle - smooth, 0.0)
    spread = float(np.median(np.abs(fast))) / 0.6745
    return np.where(np.abs(fast) < 5.0 * spread, fast, 0.0)


def attach_forms(fit: Fit) -> None:
    """Give every strong part that has none its directions of form error, at its usual scale."""
    held = any(part.name == FIXED for part in fit.parts)
    if not held and fit.record.motion.inertia_nm_s2 > 0.0 and _accelerates(fit.record):
        fit.parts.append(Part(FIXED, None, np.zeros(0)))
    for index, part in enumerate(fit.parts):
        if bool(np.any((fit.owner == index) & fit.form)):
            continue
        if part.name != FIXED:
            flat = fit.flat(index)
            information = fit.information[np.ix_(flat, flat)]
            amount = fit.coefficients[flat]
            if float(amount @ information @ amount) < STRONG:
                continue
        rows = form_rows(fit, index)
        if len(rows):
            fit.add_form(index, rows)
            part.form_scale = usual_scale(part)
    fit.settle(1)


def _accelerates(record: Record) -> bool:
    motion = record.motion
    largest = float(np.abs(motion.acceleration_rad_s2[record.valid]).max())
    return largest > _ABOVE_NOISE * motion.acceleration_noise_rad_s2


def best_form_move(fit: Fit) -> tuple[float, int, float] | None:
    """Return the change of one form scale that gains most: nats, part, scale; None without one."""
    moments = fit.all_moments()

    def value() -> float:
        tried = moments.with_penalty(fit.penalty).without(~fit.active)
        return solve(tried, fit.shapes, fit.spectrum, rounds=1).likelihood - _cost(fit)

    base, best = value(), None
    for index, part in enumerate(fit.parts):
        if not np.any((fit.owner == index) & fit.form):
            continue
        before = part.form_scale
        for scale in _neighbours(before):
            part.form_scale = scale
            gain = value() - base
            if best is None or gain > best[0]:
                best = (gain, index, scale)
        part.form_scale = before
    return best


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
    law = part.term is not None and part.term.cause.locked_to not in ("motor", "clock")
    return USUAL if law else 0.0


def _cost(fit: Fit) -> float:
    held = np.zeros(len(fit.parts), dtype=bool)
    held[np.unique(fit.owner[fit.form])] = True
    return _SCALE_PRICE * sum(
        part.form_scale != usual_scale(part) for part, h in zip(fit.parts, held, strict=True) if h
    )
