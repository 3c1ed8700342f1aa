"""Causes of the sensor, its zero and the arm: what a known torque becomes in the bridge."""

from __future__ import annotations

import numpy as np

from hdbench.model.causes._memory import first_order, plays, remembered, spread_out
from hdbench.model.causes._parts import (
    REFERENCE_LOAD_NM,
    STANDING_RAD_S,
    Computed,
    Shape,
    all_of,
    both_signs,
    has_load,
    known_applied_nm,
    known_torque,
    largest_size,
    lasts,
    loaded,
    no_column,
    output_turns,
    pair,
    single,
    torque_turns,
)
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

# shortest time constant of a warm-up in the catalogue
_SHORTEST_S = 5.0


def _since_start(motion: Motion) -> FloatArray:
    return np.asarray(motion.time_s - motion.time_s[0])


def _creep(motion: Motion, shape: Shape) -> FloatArray:
    applied = motion.applied_nm
    at, starts = remembered(motion, applied)
    torque, constant = applied[at], shape["time_constant_s"]
    step = np.diff(motion.time_s[at], prepend=motion.time_s[at[:1]])
    ratio = step / constant
    done = -np.expm1(-ratio)
    change = np.diff(torque, prepend=torque[:1])
    # share of a change, linear over the step, that has crept in by its end: 1 - done / ratio, which
    # loses its digits for a short step; its series to second order is exact to 1e-13 below 1e-4
    short = ratio < 1e-4
    late = np.where(
        short, ratio / 2.0 - ratio * ratio / 6.0, 1.0 - done / np.where(short, 1.0, ratio)
    )
    drive = (torque - change) * done + change * late
    state = first_order(np.where(starts, 0.0, 1.0 - done), np.where(starts, 0.0, drive))
    return single(spread_out(state, at, len(motion)))


def _creep_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    steps = np.diff(motion.time_s)
    span = float(motion.time_s[-1] - motion.time_s[0])
    # faster than two samples creep is part of the gain; slower than thrice the record it is the
    # integral of the load, whatever the time constant
    return {"time_constant_s": (2.0 * float(np.median(steps)) if len(steps) else 0.0, 3.0 * span)}


# a power of this is nothing beside 1: tanh x = x (1 - x^2 / 3)
_FAR_BELOW = 1e-9
# from forty times a limit on the hyperbolic tangent is 1 to the last digit, at any sharpness
_FAR_ABOVE = 40.0
# a play nearer to the largest torque takes nearly all of it: that is a gain, and no clearance of a
# joint (0.5 to 2 N m on a drive of 40 N m) comes near
_PLAY_SHARE = 0.3
# elements whose yields lie evenly between 0 and the largest: the curve of first loading is within
# 1/(8 n^2) = 0.2 % of the parabola of infinitely many
_ELEMENTS = 8
# where the angle of static readings comes from, as `motion_from_loads` says
_READINGS = "position_rad"


def whole_signal(motion: Motion) -> FloatArray:
    """Return the torque in the channel."""
    return motion.applied_nm if motion.simulated_nm is None else motion.simulated_nm


def _cubic(motion: Motion, _: Shape) -> FloatArray:
    share = motion.applied_nm / REFERENCE_LOAD_NM
    return single(share * share * share)


def _backlash(motion: Motion, shape: Shape) -> FloatArray:
    play = shape["play_nm"]
    return single(-np.clip(motion.applied_nm, -play, play))


def _saturation(motion: Motion, shape: Shape) -> FloatArray:
    limit, power, torque = shape["limit_nm"], shape["sharpness"], whole_signal(motion)
    size = np.abs(torque) / limit
    # far above a sharp limit the power is infinite and its hyperbolic tangent 1; far below it is
    # nothing, and the tangent is the power
    raised = np.minimum(size, _FAR_ABOVE) ** power
    share = np.where(raised > _FAR_BELOW, np.tanh(raised) / np.maximum(raised, _FAR_BELOW), 1.0)
    held = np.where(size > _FAR_ABOVE, limit, np.abs(torque) * share ** (1.0 / power))
    return single(np.copysign(held, torque) - torque)


def _play_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    return {"play_nm": (0.0, _PLAY_SHARE * largest_size(motion.applied_nm, motion))}


def _limit_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    largest = largest_size(whole_signal(motion), motion)
    # a limit sixty times the largest torque takes a ten-thousandth of it; one of less than half of
    # it leaves a square wave, and what it takes is a share of the torque: a gain
    return {"limit_nm": (0.5 * largest, 60.0 * largest)}


def _standing(motion: Motion) -> bool:
    """Return whether the motor stands throughout: readings under locked load."""
    speed = np.abs(motion.velocity_rad_s[motion.valid])
    return not bool((speed > STANDING_RAD_S).any())


def _sag(motion: Motion, _: Shape) -> FloatArray:
    share = motion.applied_nm / REFERENCE_LOAD_NM
    if _standing(motion):
        return np.column_stack((share * np.abs(share), share * share))
    weight = 1.0 if has_load(motion) is not None else share * share
    return pair(2.0 * motion.output_angle_rad, weight)


def _sag_applicable(motion: Motion) -> str | None:
    return loaded(motion) if _standing(motion) else output_turns(0.5)(motion)


def _yields(shape: Shape) -> FloatArray:
    return np.asarray(shape["yield_nm"] * (np.arange(_ELEMENTS) + 0.5) / _ELEMENTS)


def _loop(motion: Motion, shape: Shape) -> FloatArray:
    applied = motion.applied_nm
    at, starts = remembered(motion, applied)
    torque = applied[at]
    yields = _yields(shape)
    loop = (_ELEMENTS * torque - plays(torque, yields, starts)) / yields.sum()
    # the gain of a calibration is fitted with all loops of the sensor in it; its readings need none
    gain = np.zeros(len(motion)) if motion.angle_source == _READINGS else applied
    return np.column_stack((spread_out(loop, at, len(motion)), gain))


def _yield_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    torque = known_applied_nm(motion)
    span = float(np.ptp(torque)) if len(torque) else 0.0
    # elements beyond half the span never yield: from there on the loop keeps its form, a parabola
    return {"yield_nm": (0.01 * span, 0.5 * span)}


def _possible_loops(motion: Motion, shape: Shape) -> FloatArray:
    """Return the loop with all that a gain leaves of it, and without any.

    A gain that was calibrated with the loop holds a part of its slope: between nothing and the
    chord of its first loading up to the largest torque. More, or of the other sign, is an error of
    the gain.
    """
    largest = max(largest_size(motion.applied_nm, motion), np.finfo(float).tiny)
    yields = _yields(shape)
    chord = float(np.minimum(yields, largest).sum() / yields.sum()) / largest
    return np.array([[1.0, 1.0], [0.0, -chord]])


COMPUTED = {
    "gain-error": Computed(lambda m, _: single(m.applied_nm), known_torque),
    "cubic-nonlinearity": Computed(_cubic, loaded),
    "backlash": Computed(_backlash, all_of(loaded, both_signs), reach=_play_reach),
    "saturation": Computed(_saturation, loaded, reach=_limit_reach),
    "arm-sag": Computed(_sag, _sag_applicable),
    "side-force": Computed(lambda m, _: single(np.abs(m.applied_nm) / REFERENCE_LOAD_NM), loaded),
    "direction-asymmetry": Computed(lambda m, _: single(np.abs(m.applied_nm)), loaded),
    "hysteresis": Computed(
        _loop, all_of(loaded, torque_turns), reach=_yield_reach, possible=_possible_loops
    ),
    "zero-step": Computed(lambda m, s: single(np.where(m.time_s >= s["step_time_s"], 1.0, 0.0))),
    "zero-drift": Computed(lambda m, _: single(_since_start(m))),
    "warm-up": Computed(
        lambda m, s: single(-np.expm1(-_since_start(m) / s["time_constant_s"])), lasts(_SHORTEST_S)
    ),
    "zero-random-walk": Computed(no_column, lasts(1.0)),
    "creep": Computed(_creep, all_of(loaded, lasts(1.0)), reach=_creep_reach),
}
