"""Causes of the sensor and of the arm: what a known torque becomes in the bridge."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.model.causes._memory import plays, remembered, spread_out
from hdbench.model.causes._needs import (
    STANDING_RAD_S,
    all_of,
    both_signs,
    has_load,
    known_torque,
    loaded,
    output_turns,
    torque_turns,
)
from hdbench.model.causes._parts import REFERENCE_LOAD_NM, Computed, no_shape, pair, single
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

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


def _applied(motion: Motion) -> FloatArray:
    return single(motion.applied_nm)


def _cubic(motion: Motion) -> FloatArray:
    share = motion.applied_nm / REFERENCE_LOAD_NM
    return single(share * share * share)


def _backlash(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    play = shape["play_nm"]
    return single(-np.clip(motion.applied_nm, -play, play))


def _saturation(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    limit, power, torque = shape["limit_nm"], shape["sharpness"], whole_signal(motion)
    size = np.abs(torque) / limit
    # far above a sharp limit the power is infinite and its hyperbolic tangent 1; far below it is
    # nothing, and the tangent is the power
    raised = np.minimum(size, _FAR_ABOVE) ** power
    share = np.where(raised > _FAR_BELOW, np.tanh(raised) / np.maximum(raised, _FAR_BELOW), 1.0)
    held = np.where(size > _FAR_ABOVE, limit, np.abs(torque) * share ** (1.0 / power))
    return single(np.copysign(held, torque) - torque)


def _largest(torque: FloatArray, motion: Motion) -> float:
    known = np.abs(torque[motion.valid & np.isfinite(torque)])
    return float(known.max()) if len(known) else 0.0


def _play_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    return {"play_nm": (0.0, _PLAY_SHARE * _largest(motion.applied_nm, motion))}


def _limit_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    largest = _largest(whole_signal(motion), motion)
    # a limit sixty times the largest torque takes a ten-thousandth of it; one of less than half of
    # it leaves a square wave, and what it takes is a share of the torque: a gain
    return {"limit_nm": (0.5 * largest, 60.0 * largest)}


def _standing(motion: Motion) -> bool:
    """Return whether the motor stands throughout: readings under locked load."""
    speed = np.abs(motion.velocity_rad_s[motion.valid])
    return not bool((speed > STANDING_RAD_S).any())


def _sag(motion: Motion) -> FloatArray:
    share = motion.applied_nm / REFERENCE_LOAD_NM
    if _standing(motion):
        return np.column_stack((share * np.abs(share), share * share))
    weight = 1.0 if has_load(motion) is not None else share * share
    return pair(2.0 * motion.output_angle_rad, weight)


def _sag_applicable(motion: Motion) -> str | None:
    return loaded(motion) if _standing(motion) else output_turns(0.5)(motion)


def _magnitude(motion: Motion) -> FloatArray:
    return single(np.abs(motion.applied_nm))


def _magnitude_in_nm(motion: Motion) -> FloatArray:
    return single(np.abs(motion.applied_nm) / REFERENCE_LOAD_NM)


def _loop(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    applied = motion.applied_nm
    at, starts = remembered(motion, applied)
    torque = applied[at]
    yields = shape["yield_nm"] * (np.arange(_ELEMENTS) + 0.5) / _ELEMENTS
    loop = (_ELEMENTS * torque - plays(torque, yields, starts)) / yields.sum()
    # the gain of a calibration is fitted with all loops of the sensor in it; its readings need none
    gain = np.zeros(len(motion)) if motion.angle_source == _READINGS else applied
    return np.column_stack((spread_out(loop, at, len(motion)), gain))


def _yield_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    torque = motion.applied_nm[motion.valid & np.isfinite(motion.applied_nm)]
    span = float(np.ptp(torque)) if len(torque) else 0.0
    # elements beyond half the span never yield: from there on the loop keeps its form, a parabola
    return {"yield_nm": (0.01 * span, 0.5 * span)}


def _possible_loops(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    """Return the loop with all that a gain leaves of it, and without any.

    A gain that was calibrated with the loop holds a part of its slope: between nothing and the
    chord of its first loading up to the largest torque. More, or of the other sign, is an error of
    the gain.
    """
    torque = motion.applied_nm[motion.valid & np.isfinite(motion.applied_nm)]
    largest = max(float(np.abs(torque).max(initial=0.0)), np.finfo(float).tiny)
    yields = shape["yield_nm"] * (np.arange(_ELEMENTS) + 0.5) / _ELEMENTS
    chord = float(np.minimum(yields, largest).sum() / yields.sum()) / largest
    return np.array([[1.0, 1.0], [0.0, -chord]])


COMPUTED = {
    "gain-error": Computed(no_shape(_applied), known_torque),
    "cubic-nonlinearity": Computed(no_shape(_cubic), loaded),
    "backlash": Computed(_backlash, all_of(loaded, both_signs), reach=_play_reach),
    "saturation": Computed(_saturation, loaded, reach=_limit_reach),
    "arm-sag": Computed(no_shape(_sag), _sag_applicable),
    "side-force": Computed(no_shape(_magnitude_in_nm), loaded),
    "direction-asymmetry": Computed(no_shape(_magnitude), loaded),
    "hysteresis": Computed(
        _loop, all_of(loaded, torque_turns), reach=_yield_reach, possible=_possible_loops
    ),
}
