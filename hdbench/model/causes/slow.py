"""Causes that change slowly or once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.model.causes._needs import lasts
from hdbench.model.causes._parts import no_column, no_shape, single, torque_parameter
from hdbench.model.definition import Cause, Parameter
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["TIME_LIMIT_S", "WARM_UP", "ZERO_DRIFT", "ZERO_RANDOM_WALK", "ZERO_STEP"]

# time stamps of any record: a little over eleven days to both sides of zero
TIME_LIMIT_S = 1e6


def _since_start(motion: Motion) -> FloatArray:
    return np.asarray(motion.time_s - motion.time_s[0])


def _step(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    return single(np.where(motion.time_s >= shape["step_time_s"], 1.0, 0.0))


def _drift(motion: Motion) -> FloatArray:
    return single(_since_start(motion))


def _warm_up(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    return single(-np.expm1(-_since_start(motion) / shape["time_constant_s"]))


_TIME_CONSTANT = Parameter(
    "time_constant_s", "s", 5.0, 7200.0, "time in which all but 1/e of the change is done"
)
ZERO_STEP = Cause(
    name="zero-step",
    equation="b H(t - t_0)",
    shape=(Parameter("step_time_s", "s", -TIME_LIMIT_S, TIME_LIMIT_S, "time of the step, t_0"),),
    linear=(torque_parameter("step_nm", "change of the zero, b"),),
    locked_to="time",
    parity="does not depend on speed or load",
    channel="sensor",
    look_alikes=("coulomb-friction", "warm-up", "zero-random-walk"),
    experiment="rest before and after; repeat the reversals",
    source="change of a sensor's zero in one moment",
    columns=_step,
    harmonic=False,
)
ZERO_DRIFT = Cause(
    name="zero-drift",
    equation="b (t - t_start)",
    shape=(),
    linear=(
        Parameter("drift_nm_per_s", "N m/s", -1000.0, 1000.0, "rate of change of the zero, b"),
    ),
    locked_to="time",
    parity="does not depend on speed or load",
    channel="sensor",
    look_alikes=("warm-up", "zero-random-walk", "creep"),
    experiment="rest, run, rest, with temperature recorded, for twice the warm-up time",
    source="first term of a slow change of a sensor's zero in powers of time",
    columns=no_shape(_drift),
    harmonic=False,
)
WARM_UP = Cause(
    name="warm-up",
    equation="b (1 - exp(-(t - t_start) / T_c))",
    shape=(_TIME_CONSTANT,),
    linear=(torque_parameter("rise_nm", "change of the zero after a long time, b"),),
    locked_to="time",
    parity="does not depend on speed or load",
    channel="sensor",
    look_alikes=("zero-drift", "creep", "zero-step", "zero-random-walk"),
    experiment="rest, run, rest, with temperature recorded, for twice the warm-up time",
    source="first-order approach to thermal balance",
    columns=_warm_up,
    harmonic=False,
    applicable=lasts(_TIME_CONSTANT.lower),
)

ZERO_RANDOM_WALK = Cause(
    name="zero-random-walk",
    equation="a zero that walks: standard deviation s sqrt(t) after the time t",
    shape=(
        Parameter(
            "intensity_nm_per_sqrt_s", "N m/s^0.5", 1e-6, 100.0, "step of the zero in one second, s"
        ),
    ),
    linear=(),
    locked_to="time",
    parity="does not depend on speed or load",
    channel="sensor",
    look_alikes=("zero-drift", "warm-up", "zero-step"),
    experiment="rest, run, rest, repeated: a drift comes back the same, a walk does not",
    source="Wiener process: increments of independent time are independent",
    columns=no_column,
    harmonic=False,
    applicable=lasts(1.0),
    additive=False,
)
