"""Friction that depends on the load, or on the way since a reversal."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.model.causes._memory import first_order, remembered, spread_out
from hdbench.model.causes._needs import STANDING_RAD_S, all_of, loaded, moves_and_reverses
from hdbench.model.causes._parts import ratio_parameter, single, torque_parameter
from hdbench.model.causes.friction import TRANSITION
from hdbench.model.definition import Cause, Parameter
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["LOAD_FRICTION", "PRESLIDING"]


def _load_friction(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    direction = np.tanh(motion.velocity_rad_s / shape["transition_rad_s"])
    return single(np.abs(motion.applied_nm) * direction)


def _presliding(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    at, starts = remembered(motion, motion.angle_rad)
    way = np.diff(motion.angle_rad[at], prepend=motion.angle_rad[at[:1]])
    left = np.where(starts, 0.0, np.exp(-np.abs(way) / shape["breakaway_rad"]))
    speed = motion.velocity_rad_s[at]
    begin = np.where(np.abs(speed) > STANDING_RAD_S, np.sign(speed), 0.0)
    state = first_order(left, np.where(starts, begin, np.sign(way) * (1.0 - left)))
    return single(spread_out(state, at, len(motion)))


LOAD_FRICTION = Cause(
    name="load-dependent-friction",
    equation="mu abs(tau) tanh(w / w_0)",
    shape=(TRANSITION,),
    linear=(ratio_parameter("friction_per_load", "friction per torque transmitted, mu"),),
    locked_to="velocity",
    parity="odd in speed, even in load",
    channel="mechanical",
    look_alikes=("coulomb-friction", "gain-error", "hysteresis"),
    experiment="both directions under three loads, one of them none",
    source="Bittencourt et al. 2010, LiTH-ISY-R-2948 (friction that grows with load)",
    columns=_load_friction,
    harmonic=False,
    applicable=all_of(moves_and_reverses, loaded),
)
PRESLIDING = Cause(
    name="presliding",
    equation="F_c z, dz / d abs(theta_m) = (sign(w) - z) / theta_b",
    shape=(
        Parameter(
            "breakaway_rad", "rad", 0.01, 5.0, "motor angle in which all but 1/e is done, theta_b"
        ),
    ),
    linear=(torque_parameter("coulomb_nm", "dry friction after a long way, F_c"),),
    locked_to="velocity",
    parity="odd in direction, even in load; a matter of way, not of speed",
    channel="mechanical",
    look_alikes=("coulomb-friction", "stribeck-friction", "hysteresis"),
    experiment="slow reversals (0.1 Hz) at two speeds: they overlay in angle since the reversal",
    source="P. R. Dahl 1968, Aerospace Corporation TOR-0158(3107-18)-1",
    columns=_presliding,
    harmonic=False,
    form_of="coulomb-friction",
    applicable=moves_and_reverses,
)
