"""Friction of the output side, as the torque sensor sees it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hdbench.model.causes._needs import (
    STANDING_RAD_S,
    all_of,
    moves_and_reverses,
    reverses,
    size_of_speed_varies,
    speed_varies,
)
from hdbench.model.causes._parts import TORQUE_LIMIT_NM, no_shape, single, torque_parameter
from hdbench.model.definition import Cause, Parameter
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["ASYMMETRIC", "COULOMB", "STRIBECK", "TRANSITION", "TUTTLE", "VISCOUS"]

TRANSITION = Parameter(
    "transition_rad_s", "rad/s", 0.05, 20.0, "motor speed over which the sign is smoothed"
)
_STRIBECK = Parameter("stribeck_rad_s", "rad/s", 1.0, 80.0, "motor speed at which 1/e is left")
# samples slower than the Stribeck speed's domain that a record must have to show the effect
_SLOW_SAMPLES = 20
TUTTLE = "Tuttle and Seering 1996: harmonic-drive friction varies non-linearly with velocity"


def _coulomb(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    return single(np.tanh(motion.velocity_rad_s / shape["transition_rad_s"]))


def _viscous(motion: Motion) -> FloatArray:
    return single(motion.velocity_rad_s)


def _stribeck(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    velocity = motion.velocity_rad_s
    excess = np.exp(-((velocity / shape["stribeck_rad_s"]) ** 2))
    return single(excess * np.tanh(velocity / shape["transition_rad_s"]))


def _asymmetric(motion: Motion) -> FloatArray:
    size = np.abs(motion.velocity_rad_s)
    return np.column_stack((np.tanh(size / STANDING_RAD_S), size))


def _moves_slowly(motion: Motion) -> str | None:
    speed = np.abs(motion.velocity_rad_s[motion.valid])
    slow = int(((speed > TRANSITION.lower) & (speed < _STRIBECK.upper)).sum())
    if slow >= _SLOW_SAMPLES:
        return None
    return (
        f"{slow} samples move slower than {_STRIBECK.upper:g} rad/s; needed: {_SLOW_SAMPLES} to "
        "see friction fall with speed"
    )


COULOMB = Cause(
    name="coulomb-friction",
    equation="F_c tanh(w / w_0)",
    shape=(TRANSITION,),
    linear=(torque_parameter("coulomb_nm", "dry friction of the output side"),),
    locked_to="velocity",
    parity="odd in speed, even in load",
    channel="mechanical",
    look_alikes=("hysteresis", "zero-step", "backlash", "stribeck-friction", "presliding"),
    experiment="at least four reversals of speed, in steps of both signs",
    source=TUTTLE,
    columns=_coulomb,
    harmonic=False,
    common=True,
    applicable=moves_and_reverses,
)
VISCOUS = Cause(
    name="viscous-friction",
    equation="F_v w",
    shape=(),
    linear=(
        Parameter("viscous_nm_s_per_rad", "N m s/rad", -100.0, 100.0, "torque per motor speed"),
    ),
    locked_to="velocity",
    parity="odd in speed, even in load",
    channel="mechanical",
    look_alikes=("stribeck-friction", "creep", "coulomb-friction"),
    experiment="speeds over at least 1:5, both directions",
    source=TUTTLE,
    columns=no_shape(_viscous),
    harmonic=False,
    common=True,
    applicable=speed_varies,
)
STRIBECK = Cause(
    name="stribeck-friction",
    equation="(F_s - F_c) exp(-(w / w_s)^2) tanh(w / w_0)",
    shape=(_STRIBECK, TRANSITION),
    linear=(
        Parameter("excess_nm", "N m", 0.0, TORQUE_LIMIT_NM, "static above dry friction, F_s - F_c"),
    ),
    locked_to="velocity",
    parity="odd in speed, even in load",
    channel="mechanical",
    look_alikes=("coulomb-friction", "viscous-friction", "presliding"),
    experiment="speeds in equal ratios from 1 rad/s up, both directions",
    source="Bittencourt et al. 2010, LiTH-ISY-R-2948 (friction that falls with speed)",
    columns=_stribeck,
    harmonic=False,
    applicable=all_of(moves_and_reverses, _moves_slowly),
)
ASYMMETRIC = Cause(
    name="asymmetric-friction",
    equation=f"D_c tanh(abs(w) / {STANDING_RAD_S:g} rad/s) + D_v abs(w): "
    "forward F_c + D_c and F_v + D_v, backward F_c - D_c and F_v - D_v",
    shape=(),
    linear=(
        # without standstill this one is the zero
        replace(
            torque_parameter(
                "coulomb_difference_nm", "dry friction, forward less backward, halved, D_c"
            ),
            evident=False,
        ),
        Parameter(
            "viscous_difference_nm_s_per_rad",
            "N m s/rad",
            -100.0,
            100.0,
            "torque per motor speed, forward less backward, halved, D_v",
        ),
    ),
    locked_to="velocity",
    parity="even in speed, even in load",
    channel="mechanical",
    look_alikes=("zero-step", "zero-drift", "warm-up", "hysteresis"),
    experiment="both directions at two speeds or more, and standstill between them",
    source="the even part of a friction law; seals and bearings under preload have one",
    columns=no_shape(_asymmetric),
    harmonic=False,
    applicable=all_of(reverses, size_of_speed_varies),
)
