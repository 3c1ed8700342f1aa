"""Causes that follow the output."""

from __future__ import annotations

import numpy as np

from hdbench.model.causes._needs import loaded, output_turns
from hdbench.model.causes._parts import REFERENCE_LOAD_NM, no_shape, pair, pair_parameters
from hdbench.model.definition import Cause
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["ANGULAR_MISALIGNMENT", "LOAD_GRAVITY", "MISALIGNMENT", "POSITION_GAIN"]


# output turns on which a torque once per turn bends enough to be told from a zero and a drift
_ARC = 0.25


def _once(motion: Motion) -> FloatArray:
    return pair(motion.output_angle_rad)


def _twice(motion: Motion) -> FloatArray:
    return pair(2.0 * motion.output_angle_rad)


def _position_gain(motion: Motion) -> FloatArray:
    share = motion.applied_nm / REFERENCE_LOAD_NM
    angle = motion.output_angle_rad
    return np.hstack((pair(angle, share), pair(2.0 * angle, share)))


MISALIGNMENT = Cause(
    name="misalignment",
    equation="A cos(theta_o + phase)",
    shape=(),
    linear=pair_parameters("the torque once per output turn"),
    locked_to="output",
    parity="amplitude and phase do not change with sign of speed",
    channel="sensor",
    look_alikes=("load-gravity",),
    experiment="arm on and off, or motor current: gravity needs motor torque, misalignment none",
    source="Taghirad, CIM-TR-97-06, section 5; Taghirad, Helmy, Belanger, doi:10.1109/19.728840",
    columns=no_shape(_once),
    harmonic=True,
    applicable=output_turns(_ARC),
)
ANGULAR_MISALIGNMENT = Cause(
    name="angular-misalignment",
    equation="A cos(2 theta_o + phase)",
    shape=(),
    linear=pair_parameters("the torque twice per output turn"),
    locked_to="output",
    parity="amplitude and phase do not change with sign of speed",
    channel="sensor",
    look_alikes=("arm-sag",),
    experiment="clamp the load again, one screw further: amplitude and phase change",
    source="second harmonic of the output angle, as of a shaft joint at an angle",
    columns=no_shape(_twice),
    harmonic=True,
    applicable=output_turns(0.5),
)
LOAD_GRAVITY = Cause(
    name="load-gravity",
    equation="m g r cos(theta_o + phase)",
    shape=(),
    linear=pair_parameters("the weight's torque"),
    locked_to="output",
    parity="amplitude and phase do not change with sign of speed",
    channel="mechanical",
    look_alikes=("misalignment",),
    experiment="arm on and off, or motor current: gravity needs motor torque, misalignment none",
    source="moment of a weight m g at radius r about a level axis",
    columns=no_shape(_once),
    harmonic=True,
    applicable=output_turns(_ARC),
)

POSITION_GAIN = Cause(
    name="position-dependent-gain",
    equation="tau / 10 N m (A1 cos(theta_o + phase1) + A2 cos(2 theta_o + phase2))",
    shape=(),
    linear=(
        *pair_parameters(f"the torque once per output turn under {REFERENCE_LOAD_NM:g} N m", "_1"),
        *pair_parameters(f"the torque twice per output turn under {REFERENCE_LOAD_NM:g} N m", "_2"),
    ),
    locked_to="output",
    parity="odd in load, even in speed",
    channel="sensor",
    look_alikes=("gain-error", "gain-ripple", "side-force"),
    experiment="locked load at four output angles or more, both signs of load",
    source="bridge on a flexspline: bending and side force change its gain with the position",
    columns=no_shape(_position_gain),
    harmonic=False,
    # at one angle it is a gain error: both names then
    applicable=loaded,
)
