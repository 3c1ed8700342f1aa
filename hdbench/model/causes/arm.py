"""Causes of the arm that carries the weights, and of the direction of loading."""

from __future__ import annotations

import numpy as np

from hdbench.model.causes._needs import (
    STANDING_RAD_S,
    has_load,
    loaded,
    output_turns,
)
from hdbench.model.causes._parts import (
    REFERENCE_LOAD_NM,
    no_shape,
    pair,
    ratio_parameter,
    single,
    torque_parameter,
)
from hdbench.model.definition import Cause
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["ARM_SAG", "DIRECTION_ASYMMETRY", "SIDE_FORCE"]


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


ARM_SAG = Cause(
    name="arm-sag",
    equation="locked: (a tau abs(tau) + b tau^2) / (10 N m)^2; moving: a cos(2 theta_o) + "
    "b sin(2 theta_o), times (tau / 10 N m)^2 where the load is known",
    shape=(),
    linear=(
        torque_parameter("first_nm", "a: hanging point off the arm's line; cosine part"),
        torque_parameter("second_nm", "b: arm not level without load; sine part"),
    ),
    locked_to="output",
    parity="grows with the square of the weight",
    channel="mechanical",
    look_alikes=("cubic-nonlinearity", "angular-misalignment", "direction-asymmetry"),
    experiment="five loads or more, hung on the arm's line and below it; a stiffer arm; moving: "
    "two weights and none",
    source="arm at the angle p, stiffness k: F L cos(p + F L / k) = F L cos p - (F L)^2 sin p / k",
    columns=no_shape(_sag),
    harmonic=False,
    applicable=_sag_applicable,
)
SIDE_FORCE = Cause(
    name="side-force",
    equation="A abs(tau) / 10 N m, the radial force being abs(tau) / arm",
    shape=(),
    linear=(
        torque_parameter("side_nm", f"reading of the side force at {REFERENCE_LOAD_NM:g} N m, A"),
    ),
    locked_to="load",
    parity="even in load",
    channel="sensor",
    look_alikes=("direction-asymmetry", "arm-sag", "gain-error"),
    experiment="both directions with a second arm length, or a couple of two equal forces",
    source="one arm: the weight pulls down in both directions, the torque changes its sign",
    columns=no_shape(_magnitude_in_nm),
    harmonic=False,
    # under load of one sign it is a gain error: both names then
    applicable=loaded,
)
DIRECTION_ASYMMETRY = Cause(
    name="direction-asymmetry",
    equation="a abs(tau)",
    shape=(),
    linear=(ratio_parameter("asymmetry", "half of the gains' difference between directions, a"),),
    locked_to="load",
    parity="even in load",
    channel="sensor",
    look_alikes=("side-force", "arm-sag", "gain-error"),
    experiment="both directions with a second arm length, or a couple of two equal forces",
    source="gains of the two directions of loading, VDI/VDE 2646 and EURAMET cg-14",
    columns=no_shape(_magnitude),
    harmonic=False,
    # under load of one sign it is a gain error: both names then
    applicable=loaded,
)
