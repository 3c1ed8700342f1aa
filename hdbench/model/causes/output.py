"""Causes that follow the output."""

from __future__ import annotations

from hdbench.model.causes._parts import no_shape, output_turns, pair, pair_parameters
from hdbench.model.definition import Cause
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["OUTPUT_CAUSES"]


def _once(motion: Motion) -> FloatArray:
    return pair(motion.output_angle_rad)


def _twice(motion: Motion) -> FloatArray:
    return pair(2.0 * motion.output_angle_rad)


_MISALIGNMENT = Cause(
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
    applicable=output_turns(1.0),
)
_ANGULAR = Cause(
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
    applicable=output_turns(1.0),
)
_GRAVITY = Cause(
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
    applicable=output_turns(1.0),
)

OUTPUT_CAUSES = (_MISALIGNMENT, _ANGULAR, _GRAVITY)
