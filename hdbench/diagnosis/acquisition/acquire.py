"""One trace inspected: what can be trusted, what was taken out, and what has a name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.acquisition.channels import (
    ANGLE_COLUMNS,
    VELOCITY_COLUMNS,
    shaft_of,
    velocity_of,
)
from hdbench.diagnosis.acquisition.faults import Fault, restored, tacho_faults
from hdbench.diagnosis.acquisition.flags import DataFlag, flag_samples
from hdbench.diagnosis.acquisition.judge import judge_jumps, longest_fit
from hdbench.diagnosis.acquisition.known import known_taken_out
from hdbench.diagnosis.acquisition.measure import Residual, baseline_residual
from hdbench.diagnosis.acquisition.modelled import faults_as_causes
from hdbench.diagnosis.acquisition.named import Acquired
from hdbench.diagnosis.acquisition.phase import find_phase_jumps
from hdbench.diagnosis.acquisition.slips import encoder_glitches, velocity_spikes
from hdbench.diagnosis.acquisition.units import check_channels
from hdbench.diagnosis.measured.preflight import Preflight, inspect_trace
from hdbench.diagnosis.measured.record import Record, torque_from_trace
from hdbench.model import BenchModel, motion_from_trace
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import Trace

__all__ = ["Inspected", "Prepare", "inspect_channels", "moving_causes"]

Prepare = Callable[[Trace, NDArray[np.bool_]], Record]


@dataclass(frozen=True, slots=True)
class Inspected:
    """A trace after its channels were inspected.

    Parameters
    ----------
    given : Trace
        Channels that can be trusted, before faults of angle, tacho and clock were taken out.
    trace : Trace
        Channels with those taken out.
    preflight : Preflight
        Flags and masked samples.
    faults : tuple of Fault
        What was taken out.
    reason : str
        Why no baseline can be fitted; empty where one can.
    """

    given: Trace
    trace: Trace
    preflight: Preflight
    faults: tuple[Fault, ...] = ()
    reason: str = ""


def _lost_at(trace: Trace, names: tuple[str, ...], mask: NDArray[np.bool_]) -> Trace:
    """Return the trace with the marked samples of some channels lost."""
    if not mask.any():
        return trace
    kept = {name: np.where(mask, np.nan, trace[name]) for name in names if name in trace}
    return trace.with_columns(**kept)


def _finite(trace: Trace) -> Trace:
    """Return the trace with infinite samples lost."""
    wrong = {
        name: np.where(np.isfinite(values), values, np.nan)
        for name, values in trace.columns.items()
        if name != "time_s" and bool(np.isinf(values).any())
    }
    return trace.with_columns(**wrong) if wrong else trace


def _without_glitches(trace: Trace, profile: ProfileData) -> tuple[Trace, list[DataFlag]]:
    """Return the trace without isolated wrong samples of tacho and encoder, and their flags."""
    flags: list[DataFlag] = []
    time = trace.time_s
    shaft = shaft_of(trace, profile)
    velocity = velocity_of(trace, profile)
    if velocity is not None:
        spikes = velocity_spikes(velocity)
        trace = _lost_at(trace, VELOCITY_COLUMNS, spikes)
        flags += flag_samples("spikes", time, spikes, "isolated samples of the velocity")
        shaft = shaft_of(trace, profile)
    if shaft is not None:
        glitches = encoder_glitches(shaft)
        trace = _lost_at(trace, ANGLE_COLUMNS, glitches)
        flags += flag_samples("spikes", time, glitches, "isolated samples of the motor angle")
    return trace, flags


def _hidden_losses(
    trace: Trace,
    profile: ProfileData,
    preflight: Preflight,
    residual_of: Callable[[Trace], Residual],
) -> list[Fault]:
    """Return samples lost without a gap in the stamps, where the angle is integrated."""
    motion = motion_from_trace(trace, profile)
    torque = torque_from_trace(trace, profile)
    period = float(np.median(np.diff(motion.time_s)))
    velocity = np.where(motion.valid, motion.velocity_rad_s, 0.0)
    # an integrated angle lies half a sample behind the shaft
    aligned = replace(motion, angle_rad=motion.angle_rad + 0.5 * period * velocity)
    valid = motion.valid & np.isfinite(torque) & ~preflight.masked
    jumps = find_phase_jumps(aligned, torque, valid, profile)
    return longest_fit(trace, jumps, residual_of)


def inspect_channels(
    trace: Trace,
    profile: ProfileData,
    model: BenchModel,
    prepare: Prepare,
    progress: Callable[[str, float], None],
) -> Inspected:
    """Inspect every channel of a trace and take out what can be modelled.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Bench.
    model : BenchModel
        Model at hand; faults that it holds are taken out and not found again.
    prepare : callable
        ``prepare(trace, masked)`` gives the record.
    progress : callable
        Called with what is being done and the share done.

    Returns
    -------
    Inspected

    Raises
    ------
    DataError
        If a channel is missing or the trace has no motion.
    """
    progress("checking units and channels", 0.005)
    channels = check_channels(_finite(trace), profile)
    if channels.reason:
        torque = torque_from_trace(trace, profile)
        nothing = Preflight(channels.flags, np.zeros(len(torque), dtype=bool))
        return Inspected(trace, trace, nothing, (), channels.reason)
    progress("checking stamps and codes", 0.01)
    first = known_taken_out(channels.trace, profile, model)
    first, glitches = _without_glitches(first, profile)
    found = inspect_trace(first, profile)
    flags = (*channels.flags, *found.flags, *glitches)
    preflight = Preflight(flags, found.masked)
    progress("holding the encoder against the tacho", 0.015)

    def residual_of(one: Trace) -> Residual:
        return baseline_residual(prepare(one, preflight.masked))

    # ripple of the tacho hides small jumps, and a jump turns the ripple's phase
    ripple = tacho_faults(first, profile)
    faults = judge_jumps(restored(first, ripple), profile, residual_of)
    if not any(name in first for name in ANGLE_COLUMNS):
        faults += _hidden_losses(first, profile, preflight, residual_of)
    # later losses first: a loss moves the stamps of all samples after it
    faults.sort(key=lambda fault: -fault.span[0])
    progress("looking for ripple of the tacho", 0.02)
    faults += tacho_faults(restored(first, faults), profile) if faults else ripple
    return Inspected(first, restored(first, faults), preflight, tuple(faults))


def moving_causes(
    inspected: Inspected, prepare: Prepare, rng: np.random.Generator
) -> list[Acquired]:
    """Return the faults of angle, tacho and clock as causes.

    Parameters
    ----------
    inspected : Inspected
        Trace after inspection.
    prepare : callable
        ``prepare(trace, masked)`` gives the record.
    rng : Generator
        For the bootstrap.

    Returns
    -------
    list of Acquired
    """
    masked = inspected.preflight.masked
    return faults_as_causes(
        inspected.given, list(inspected.faults), lambda one: prepare(one, masked), rng
    )
