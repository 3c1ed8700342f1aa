"""Causes that are no torque but a property of the channel's noise."""

from __future__ import annotations

from hdbench.model.causes._needs import speed_varies
from hdbench.model.causes._parts import REFERENCE_SPEED_RAD_S, no_column
from hdbench.model.definition import Cause, Parameter

__all__ = ["QUANTISATION", "SPEED_NOISE", "SPIKES"]

QUANTISATION = Cause(
    name="quantisation",
    equation="reading = q round(torque / q)",
    shape=(Parameter("step_nm", "N m", 1e-6, 100.0, "step of the readings, q"),),
    linear=(),
    locked_to="load",
    parity="at most q / 2; depends on the torque modulo q",
    channel="acquisition",
    look_alikes=("ripple-harmonic", "spikes"),
    experiment="a slow ramp of torque, and rest: the histogram of codes is a comb",
    source="converter of finite resolution, or bits that are stuck",
    columns=no_column,
    harmonic=False,
    additive=False,
)
SPIKES = Cause(
    name="spikes",
    equation="a share p of the samples is off by a size of s",
    shape=(
        Parameter("share", "1", 1e-9, 0.5, "share of the samples, p"),
        Parameter("size_nm", "N m", 1e-6, 1e4, "root mean square of their deviation, s"),
    ),
    linear=(),
    locked_to="time",
    parity="does not depend on speed or load",
    channel="acquisition",
    look_alikes=("speed-dependent-noise", "bearing-defect"),
    experiment="rest with the drive off, then on: contacts and switching show as single samples",
    source="loose contact or switching; sparse impulses in a channel",
    columns=no_column,
    harmonic=False,
    additive=False,
)
SPEED_NOISE = Cause(
    name="speed-dependent-noise",
    equation=f"white noise of standard deviation n abs(w) / {REFERENCE_SPEED_RAD_S:g} rad/s",
    shape=(
        Parameter("noise_nm", "N m", 1e-6, 1e3, f"at {REFERENCE_SPEED_RAD_S:g} rad/s, per sample"),
    ),
    linear=(),
    locked_to="velocity",
    parity="even in speed",
    channel="mechanical",
    look_alikes=("spikes", "bearing-defect", "ripple-harmonic"),
    experiment="constant speeds over at least 1:4 and rest: variance over speed",
    source="variance s_0^2 + s_1^2 w^2 of a channel that picks up rolling and slip-ring noise",
    columns=no_column,
    harmonic=False,
    applicable=speed_varies,
    additive=False,
)
