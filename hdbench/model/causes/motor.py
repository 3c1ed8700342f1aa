"""Causes that follow the wave generator."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.model.causes._needs import all_of, motor_turns, output_turns
from hdbench.model.causes._parts import (
    REFERENCE_SPEED_RAD_S,
    broken_orders,
    lobe_angle,
    no_shape,
    order_parameter,
    pair,
    pair_parameters,
    whole_orders,
)
from hdbench.model.definition import Cause
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = [
    "BEARING",
    "BEAT",
    "COGGING",
    "ECCENTRICITY",
    "RIPPLE_HARMONIC",
    "TOOTH_MESH",
    "UNBALANCE",
]

_REPORT = "Taghirad, CIM-TR-97-06, section 4; Taghirad, Helmy, Belanger, doi:10.1109/19.728840"
# of a three-phase motor with m pole pairs: m and 2 m by the currents (offset, unequal phases) and
# the poles, 3 m by the slots of each pole, 6 m by the six steps of the windings; 24 poles with 18
# slots have 12, 24, 36 and 72
_OF_POLES = (1, 2, 3, 6)
# orders 1, 2 and 4 are those of the wave generator and its lobes; the orders of a servo motor's
# poles and slots stay below the highest order of a ripple
_FIRST_OF_POLES, _LAST_OF_POLES, _LOBES = 3, 60, (4,)


def _at_order(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    return pair(shape["order"] * motion.angle_rad)


def _order_one(motion: Motion) -> FloatArray:
    return pair(motion.angle_rad)


def _unbalance(motion: Motion) -> FloatArray:
    return pair(motion.angle_rad, (motion.velocity_rad_s / REFERENCE_SPEED_RAD_S) ** 2)


def _beat(motion: Motion) -> FloatArray:
    carrier = lobe_angle(motion)
    lower, upper = carrier - motion.output_angle_rad, carrier + motion.output_angle_rad
    return np.hstack((pair(lower), pair(upper)))


def _mesh(motion: Motion) -> FloatArray:
    return pair(2.0 * (motion.gear_ratio + 1.0) * motion.angle_rad)


def _bearing(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    angle = shape["order"] * motion.angle_rad
    return np.hstack([pair(k * angle) for k in (1.0, 2.0, 3.0)])


def _cogging(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    angle = shape["order"] * motion.angle_rad
    return np.hstack([pair(k * angle) for k in _OF_POLES])


def _needs_measured_angle(motion: Motion) -> str | None:
    if motion.angle_source != "velocity":
        return None
    return (
        "the motor angle is an integral of the velocity, too coarse for tooth mesh; needed: "
        "motor_angle_rad or encoder_count"
    )


RIPPLE_HARMONIC = Cause(
    name="ripple-harmonic",
    equation="A cos(order theta_m + phase)",
    shape=(order_parameter(0.1, 60.0),),
    linear=pair_parameters("the ripple"),
    locked_to="motor",
    parity="amplitude and phase do not change with sign of speed or load",
    channel="sensor",
    look_alikes=(
        "structural-tone",
        "mains-hum",
        "bearing-defect",
        "torsional-resonance",
        "kinematic-error",
        "wave-generator-eccentricity",
        "cogging",
    ),
    experiment="two constant speeds: a line that keeps its order and amplitude is ripple",
    source=_REPORT,
    columns=_at_order,
    harmonic=True,
    applicable=motor_turns(1.0),
)
ECCENTRICITY = Cause(
    name="wave-generator-eccentricity",
    equation="A cos(theta_m + phase)",
    shape=(),
    linear=pair_parameters("the torque once per motor turn"),
    locked_to="motor",
    parity="amplitude and phase do not change with sign of speed or load",
    channel="mechanical",
    look_alikes=("motor-unbalance", "ripple-harmonic"),
    experiment="speed steps over at least 1:3: eccentricity keeps its amplitude",
    source="Yao, Chen, Xing 2022: main frequencies of the transmission error",
    columns=no_shape(_order_one),
    harmonic=True,
    applicable=motor_turns(1.0),
)
UNBALANCE = Cause(
    name="motor-unbalance",
    equation=f"A (w / {REFERENCE_SPEED_RAD_S:g} rad/s)^2 cos(theta_m + phase)",
    shape=(),
    linear=pair_parameters(f"the torque once per motor turn at {REFERENCE_SPEED_RAD_S:g} rad/s"),
    locked_to="motor",
    parity="even in speed",
    channel="mechanical",
    look_alikes=("wave-generator-eccentricity", "ripple-harmonic"),
    experiment="speed steps over at least 1:3: unbalance grows with speed squared",
    source="force of a turning mass m off its axis by e: m e w^2",
    columns=no_shape(_unbalance),
    harmonic=True,
    applicable=motor_turns(1.0),
)
BEAT = Cause(
    name="ripple-beat",
    equation="A1 cos(2 G theta_m - theta_o + phase1) + A2 cos(2 G theta_m + theta_o + phase2)",
    shape=(),
    linear=(
        *pair_parameters("the sideband below order 2", "_lower"),
        *pair_parameters("the sideband above order 2", "_upper"),
    ),
    locked_to="motor",
    parity="amplitude and phase do not change with sign of speed or load",
    channel="sensor",
    look_alikes=("load-dependent-ripple", "ripple-harmonic", "transmission-error"),
    experiment="at least three output turns at constant speed, with and without the arm",
    source="Jia et al. 2021, Mechanism and Machine Theory 155:104122 (beat)",
    columns=no_shape(_beat),
    harmonic=False,
    applicable=output_turns(1.0),
)
TOOTH_MESH = Cause(
    name="tooth-mesh",
    equation="A cos(2 (N + 1) theta_m + phase)",
    shape=(),
    linear=pair_parameters("the torque at the teeth of the circular spline"),
    locked_to="motor",
    parity="amplitude and phase do not change with sign of speed or load",
    channel="mechanical",
    look_alikes=("structural-tone", "mains-hum", "cogging"),
    experiment="two speeds 1 % apart: an aliased mesh line moves by 1 % of its true frequency",
    source="geometry: two lobes meet the 2 (N + 1) teeth of the circular spline once per turn",
    columns=no_shape(_mesh),
    harmonic=True,
    applicable=all_of(motor_turns(1.0), _needs_measured_angle),
)
BEARING = Cause(
    name="bearing-defect",
    equation="sum over k = 1, 2, 3 of A_k cos(k order theta_m + phase_k)",
    shape=(broken_orders(0.2, 20),),
    linear=tuple(
        parameter
        for k in (1, 2, 3)
        for parameter in pair_parameters(f"harmonic {k} of the defect", f"_{k}")
    ),
    locked_to="motor",
    parity="amplitude and phase do not change with sign of speed or load",
    channel="mechanical",
    look_alikes=("ripple-harmonic", "tooth-mesh", "cogging"),
    experiment="a hundred motor turns at constant speed: the order to 0.01 and its harmonics",
    source="Guida 2024, Machines 12:776 (failure modes); repeated impacts have harmonics",
    columns=_bearing,
    harmonic=False,
    applicable=motor_turns(100.0),
)
COGGING = Cause(
    name="cogging",
    equation="sum over k = 1, 2, 3, 6 of A_k cos(k order theta_m + phase_k), order whole",
    shape=(whole_orders(_FIRST_OF_POLES, _LAST_OF_POLES, without=_LOBES),),
    linear=tuple(
        parameter
        for k in _OF_POLES
        for parameter in pair_parameters(f"harmonic {k} of the poles", f"_{k}")
    ),
    locked_to="motor",
    parity="amplitude and phase do not change with sign of speed or load; there without load",
    channel="mechanical",
    look_alikes=("ripple-harmonic", "tooth-mesh", "bearing-defect"),
    experiment="the motor turned by hand without current; the number of its poles and slots",
    source="geometry: torque between magnets and slots has the period of their pattern",
    columns=_cogging,
    harmonic=False,
    applicable=motor_turns(1.0),
)
