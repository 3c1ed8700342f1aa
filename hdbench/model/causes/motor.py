"""Causes that follow the wave generator."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.model.causes._parts import (
    all_of,
    has_load,
    motor_turns,
    no_shape,
    order_parameter,
    output_turns,
    pair,
    pair_parameters,
)
from hdbench.model.definition import Cause
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["MOTOR_CAUSES"]

_REPORT = "Taghirad, CIM-TR-97-06, section 4; Taghirad, Helmy, Belanger, doi:10.1109/19.728840"
# amplitudes that grow with speed or load are stated at these, so that all stand in N m
UNBALANCE_SPEED_RAD_S = 100.0
RIPPLE_LOAD_NM = 10.0
# order, relative to the gauges, of the ripple that the wave generator's two lobes cause
_LOBES = 2.0


def _at_order(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    return pair(shape["order"] * motion.angle_rad)


def _order_one(motion: Motion) -> FloatArray:
    return pair(motion.angle_rad)


def _unbalance(motion: Motion) -> FloatArray:
    return pair(motion.angle_rad, (motion.velocity_rad_s / UNBALANCE_SPEED_RAD_S) ** 2)


def _lobe_angle(motion: Motion) -> FloatArray:
    return np.asarray(_LOBES * motion.gauge_factor * motion.angle_rad)


def _with_load(motion: Motion) -> FloatArray:
    load = np.nan if motion.load_torque_nm is None else np.abs(motion.load_torque_nm)
    return pair(_lobe_angle(motion), load / RIPPLE_LOAD_NM)


def _beat(motion: Motion) -> FloatArray:
    carrier = _lobe_angle(motion)
    lower, upper = carrier - motion.output_angle_rad, carrier + motion.output_angle_rad
    return np.hstack((pair(lower), pair(upper)))


def _mesh(motion: Motion) -> FloatArray:
    return pair(2.0 * (motion.gear_ratio + 1.0) * motion.angle_rad)


def _bearing(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    angle = shape["order"] * motion.angle_rad
    return np.hstack([pair(k * angle) for k in (1.0, 2.0, 3.0)])


def _needs_measured_angle(motion: Motion) -> str | None:
    if motion.angle_source != "velocity":
        return None
    return (
        "the motor angle is an integral of the velocity, too coarse for tooth mesh; needed: "
        "motor_angle_rad or encoder_count"
    )


_RIPPLE_HARMONIC = Cause(
    name="ripple-harmonic",
    equation="A cos(order theta_m + phase)",
    shape=(order_parameter(0.1, 60.0),),
    linear=pair_parameters("the ripple"),
    locked_to="motor",
    parity="amplitude and phase do not change with sign of speed or load",
    channel="sensor",
    look_alikes=("structural-tone", "mains-hum", "bearing-defect", "torsional-resonance"),
    experiment="two constant speeds: a line that keeps its order and amplitude is ripple",
    source=_REPORT,
    columns=_at_order,
    harmonic=True,
    applicable=motor_turns(1.0),
)
_ECCENTRICITY = Cause(
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
_UNBALANCE = Cause(
    name="motor-unbalance",
    equation=f"A (w / {UNBALANCE_SPEED_RAD_S:g} rad/s)^2 cos(theta_m + phase)",
    shape=(),
    linear=pair_parameters(f"the torque once per motor turn at {UNBALANCE_SPEED_RAD_S:g} rad/s"),
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
_LOAD_RIPPLE = Cause(
    name="load-dependent-ripple",
    equation=f"A abs(load) / {RIPPLE_LOAD_NM:g} N m cos(2 G theta_m + phase)",
    shape=(),
    linear=pair_parameters(f"the ripple added by {RIPPLE_LOAD_NM:g} N m of load"),
    locked_to="motor",
    parity="even in load",
    channel="sensor",
    look_alikes=("ripple-harmonic", "gain-ripple"),
    experiment="constant speed under three loads of both signs",
    source="first term of the ripple amplitude in powers of the load's magnitude",
    columns=no_shape(_with_load),
    harmonic=True,
    applicable=all_of(motor_turns(1.0), has_load),
    channels=("load_torque_nm",),
)
_BEAT = Cause(
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
    look_alikes=("load-dependent-ripple", "ripple-harmonic"),
    experiment="at least three output turns at constant speed, with and without the arm",
    source="Jia et al. 2021, Mechanism and Machine Theory 155:104122 (beat)",
    columns=no_shape(_beat),
    harmonic=False,
    applicable=output_turns(1.0),
)
_TOOTH_MESH = Cause(
    name="tooth-mesh",
    equation="A cos(2 (N + 1) theta_m + phase)",
    shape=(),
    linear=pair_parameters("the torque at the teeth of the circular spline"),
    locked_to="motor",
    parity="amplitude and phase do not change with sign of speed or load",
    channel="mechanical",
    look_alikes=("structural-tone", "mains-hum"),
    experiment="two speeds 1 % apart: an aliased mesh line moves by 1 % of its true frequency",
    source="geometry: two lobes meet the 2 (N + 1) teeth of the circular spline once per turn",
    columns=no_shape(_mesh),
    harmonic=True,
    applicable=all_of(motor_turns(1.0), _needs_measured_angle),
)
_BEARING = Cause(
    name="bearing-defect",
    equation="sum over k = 1, 2, 3 of A_k cos(k order theta_m + phase_k)",
    shape=(order_parameter(0.2, 20.0),),
    linear=tuple(
        parameter
        for k in (1, 2, 3)
        for parameter in pair_parameters(f"harmonic {k} of the defect", f"_{k}")
    ),
    locked_to="motor",
    parity="amplitude and phase do not change with sign of speed or load",
    channel="mechanical",
    look_alikes=("ripple-harmonic", "tooth-mesh"),
    experiment="a hundred motor turns at constant speed: the order to 0.01 and its harmonics",
    source="Guida 2024, Machines 12:776 (failure modes); repeated impacts have harmonics",
    columns=_bearing,
    harmonic=False,
    applicable=motor_turns(10.0),
)

MOTOR_CAUSES = (
    _RIPPLE_HARMONIC,
    _ECCENTRICITY,
    _UNBALANCE,
    _LOAD_RIPPLE,
    _BEAT,
    _TOOTH_MESH,
    _BEARING,
)
