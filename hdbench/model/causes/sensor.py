"""Causes of the sensor that need no memory: what a known torque becomes in the bridge."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.model.causes._needs import all_of, both_signs, known_torque, loaded
from hdbench.model.causes._parts import (
    RATIO_LIMIT,
    REFERENCE_LOAD_NM,
    no_shape,
    ratio_parameter,
    single,
    torque_parameter,
)
from hdbench.model.definition import Cause, Parameter
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["BACKLASH", "CUBIC_NONLINEARITY", "GAIN_ERROR", "SATURATION", "whole_signal"]


# a limiter of this sharpness is within 0.4 % of a hard stop at the limit itself, and within 0.01 %
# of it 3 % below: what a channel that is cut off gives, such as a converter at its end
_SHARPEST = 64.0


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


# a power of this is nothing beside 1: tanh x = x (1 - x^2 / 3)
_FAR_BELOW = 1e-9
# from forty times a limit on the hyperbolic tangent is 1 to the last digit, at any sharpness
_FAR_ABOVE = 40.0


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


# a play nearer to the largest torque takes nearly all of it: that is a gain, and no clearance of a
# joint (0.5 to 2 N m on a drive of 40 N m) comes near
_PLAY_SHARE = 0.3


def _play_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    return {"play_nm": (0.0, _PLAY_SHARE * _largest(motion.applied_nm, motion))}


def _limit_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    largest = _largest(whole_signal(motion), motion)
    # a limit sixty times the largest torque takes a ten-thousandth of it; one of less than half of
    # it leaves a square wave, and what it takes is a share of the torque: a gain
    return {"limit_nm": (0.5 * largest, 60.0 * largest)}


GAIN_ERROR = Cause(
    name="gain-error",
    equation="g tau",
    shape=(),
    linear=(Parameter("gain_error", "1", -0.5, 0.5, "relative error of the sensor's gain, g"),),
    locked_to="load",
    parity="odd in load, even in speed",
    channel="sensor",
    look_alikes=("inertia-error", "cubic-nonlinearity", "position-dependent-gain"),
    experiment="static weights on at least five levels of both signs",
    source="Taghirad, CIM-TR-97-06, section 3 (gain by static loads)",
    columns=no_shape(_applied),
    harmonic=False,
    applicable=known_torque,
)
CUBIC_NONLINEARITY = Cause(
    name="cubic-nonlinearity",
    equation=f"c (tau / {REFERENCE_LOAD_NM:g} N m)^3",
    shape=(),
    linear=(torque_parameter("cubic_nm", f"deviation at {REFERENCE_LOAD_NM:g} N m, c"),),
    locked_to="load",
    parity="odd in load, even in speed",
    channel="sensor",
    look_alikes=("saturation", "arm-sag", "gain-error", "piecewise-stiffness"),
    experiment="static weights on five levels or more of both signs, up to the rated torque",
    source="first odd term of a sensor's curve after its gain; EURAMET cg-14 fits a cubic",
    columns=no_shape(_cubic),
    harmonic=False,
    applicable=loaded,
)
BACKLASH = Cause(
    name="backlash",
    equation="-s clip(tau, -b, b), s = 1 where nothing is transmitted inside the play",
    shape=(Parameter("play_nm", "N m", 1e-4, 500.0, "half of the play, as a torque, b"),),
    linear=(ratio_parameter("share", "share of the torque lost inside the play, s"),),
    locked_to="load",
    parity="odd in load; only near zero torque",
    channel="mechanical",
    look_alikes=("hysteresis", "gain-error", "coulomb-friction"),
    experiment="a small torque sine about zero, and again about 10 N m",
    source="dead zone: torque is passed on beyond the play only",
    columns=_backlash,
    harmonic=False,
    applicable=all_of(loaded, both_signs),
    reach=_play_reach,
)
SATURATION = Cause(
    name="saturation",
    equation="s (L tanh(abs(y / L)^p)^(1/p) sgn y - y), y the torque in the channel, s = 1",
    shape=(
        Parameter("limit_nm", "N m", 0.1, 1e4, "torque that the channel never exceeds, L"),
        Parameter(
            "sharpness",
            "1",
            1.0,
            _SHARPEST,
            "1 for a limit that sets in slowly, 8 for a sharp knee, 64 for a hard stop, p",
            default=1.0,
        ),
    ),
    # a channel that gives more than its torque has no limit
    linear=(Parameter("share", "1", 0.0, RATIO_LIMIT, "1 for a channel with the limit L, s"),),
    locked_to="load",
    parity="odd in the whole torque, even in speed",
    channel="sensor",
    look_alikes=("cubic-nonlinearity", "cubic-stiffness", "piecewise-stiffness"),
    experiment="the highest torque of both signs; its code histogram",
    source="smooth limiter of free sharpness; a hard one is seen in the code histogram too",
    columns=_saturation,
    harmonic=False,
    applicable=loaded,
    reach=_limit_reach,
    whole_signal=True,
)
