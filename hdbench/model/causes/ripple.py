"""Ripple that depends on the load."""

from __future__ import annotations

import numpy as np

from hdbench.model.causes._needs import all_of, loaded, motor_turns
from hdbench.model.causes._parts import (
    REFERENCE_LOAD_NM,
    lobe_angle,
    no_shape,
    pair,
    pair_parameters,
)
from hdbench.model.definition import Cause
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["GAIN_RIPPLE", "LOAD_RIPPLE"]


def _with_magnitude(motion: Motion) -> FloatArray:
    return pair(lobe_angle(motion), np.abs(motion.applied_nm) / REFERENCE_LOAD_NM)


def _with_torque(motion: Motion) -> FloatArray:
    return pair(lobe_angle(motion), motion.applied_nm / REFERENCE_LOAD_NM)


LOAD_RIPPLE = Cause(
    name="load-dependent-ripple",
    equation=f"A abs(tau) / {REFERENCE_LOAD_NM:g} N m cos(2 G theta_m + phase)",
    shape=(),
    linear=pair_parameters(f"the ripple added by {REFERENCE_LOAD_NM:g} N m of load"),
    locked_to="motor",
    parity="even in load",
    channel="sensor",
    look_alikes=("ripple-harmonic", "gain-ripple", "transmission-error"),
    experiment="constant speed under three loads of both signs",
    source="first term of the ripple amplitude in powers of the load's magnitude",
    columns=no_shape(_with_magnitude),
    harmonic=True,
    applicable=all_of(motor_turns(1.0), loaded),
)
GAIN_RIPPLE = Cause(
    name="gain-ripple",
    equation=f"A tau / {REFERENCE_LOAD_NM:g} N m cos(2 G theta_m + phase)",
    shape=(),
    linear=pair_parameters(f"the ripple under {REFERENCE_LOAD_NM:g} N m of load"),
    locked_to="motor",
    parity="odd in load",
    channel="sensor",
    look_alikes=("load-dependent-ripple", "position-dependent-gain", "gain-error"),
    experiment="locked load at four motor angles 45 degrees apart, both signs of load",
    source="gain of a bridge whose gauges the wave generator's lobes pass",
    columns=no_shape(_with_torque),
    harmonic=True,
    applicable=all_of(motor_turns(1.0), loaded),
)
