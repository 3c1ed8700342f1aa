"""Inspection of a trace: what can be trusted, what takes no part, and which faults have a name."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from hdbench.diagnosis.answer.records import DataFlag
from hdbench.diagnosis.faults.converter import clipping, stuck_samples
from hdbench.diagnosis.faults.fault import Fault, flag_runs, flag_samples, robust_std
from hdbench.diagnosis.faults.jumps import find_jumps, later_from, turned_back
from hdbench.diagnosis.faults.phase import Ripple
from hdbench.diagnosis.faults.shaft import (
    ANGLES,
    VELOCITIES,
    angle_of,
    derivation,
    has_own_noise,
    shaft_of,
    velocity_of,
)
from hdbench.diagnosis.faults.stamps import gap_steps, lost_samples, repeated_rows
from hdbench.diagnosis.faults.tacho import find_tacho_ripple, without_ripple
from hdbench.diagnosis.faults.units import check_channels
from hdbench.model import BenchModel, baseline_orders
from hdbench.model.kinematics import velocity_slope
from hdbench.model.motion import torque_from_trace
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = ["Inspected", "inspect_channels"]

# an isolated sample leaves the median of five by this many times what one in a hundred does: the
# largest of a million normal samples is twice the hundredth-largest of a hundred
_OUT_RATIO = 2.5
# and by this many robust standard deviations
_OUT_SIGMA = 16.0
# and this many of the smallest steps
_OUT_STEPS = 4.0
# and the two samples on each side differ by less than this part of it
_FLAT = 0.2
_WINDOW = 5


@dataclass(frozen=True, slots=True)
class Inspected:
    """A trace after its channels were inspected.

    Parameters
    ----------
    trace : Trace
        Channels as the rest of the diagnosis sees them: what can be trusted, named faults of
        angle, tacho and clock taken out.
    masked : ndarray of bool, shape (n,)
        Samples that take no part.
    left_out : tuple of (str, int)
        Why samples take no part, and how many.
    flags : tuple of DataFlag
        Doubtful samples, those of the faults among them.
    faults : tuple of Fault
        Named faults.
    reason : str
        Why nothing can be said, with the margin; empty where something can.
    derived : tuple of (str, str)
        Channels that were made of another one, and of which.
    angle_trusted : bool
        Whether the motor angle is measured and of a sensor of its own.
    """

    trace: Trace
    masked: NDArray[np.bool_]
    left_out: tuple[tuple[str, int], ...] = ()
    flags: tuple[DataFlag, ...] = ()
    faults: tuple[Fault, ...] = ()
    reason: str = ""
    derived: tuple[tuple[str, str], ...] = ()
    angle_trusted: bool = False


def inspect_channels(
    trace: Trace, profile: ProfileData, model: BenchModel, *, alpha: float
) -> Inspected:
    """Inspect every channel of a trace before anything is fitted.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Bench.
    model : BenchModel
        Model at hand; faults that it holds are taken out and not found again.
    alpha : float
        False-alarm rate of the record, in (0, 1): a fault that is less sure is not named.

    Returns
    -------
    Inspected

    Raises
    ------
    DataError
        If the trace has no torque.
    """
    none = np.zeros(len(trace), dtype=bool)
    if len(trace) < _WINDOW:
        return Inspected(trace, none, reason=f"{len(trace)} samples; needed: at least {_WINDOW}")
    channels = check_channels(_finite(trace), profile)
    reason = channels.reason or _at_rest(channels.trace, profile)
    if reason:
        return Inspected(channels.trace, none, flags=channels.flags, reason=reason)
    trace, flags = channels.trace, channels.flags
    lost = lost_samples(trace)
    torque = torque_from_trace(trace, profile)
    trace, glitches = _without_glitches(_known_out(trace, profile, model), profile)
    clipped, saturation = clipping(trace, profile, torque)
    stuck = stuck_samples(torque) & ~clipped
    held = repeated_rows(trace) & ~clipped & ~stuck
    masked = clipped | stuck
    flags += flag_runs("stuck-value", trace.time_s, stuck) + glitches
    flags += flag_samples(
        "missed-samples", trace.time_s, held, "rows that repeat the one before; nothing is repaired"
    )
    faults = lost if saturation is None else (*lost, saturation)
    moving, repaired, derived = _moving(trace, profile, torque, masked | ~np.isfinite(torque))
    if all(one.false_alarm_probability < alpha for one in moving):
        faults, trace = (*faults, *moving), repaired
    flags += tuple(fault.flag() for fault in faults)
    reasons = {"no value": ~np.isfinite(torque), "clipped": clipped, "stuck": stuck}
    return Inspected(
        trace,
        masked,
        tuple((name, int(mask.sum())) for name, mask in reasons.items() if mask.any()),
        tuple(sorted(flags, key=lambda flag: flag.from_s)),
        faults,
        "",
        derived,
        any(name in trace for name in ANGLES) and all(one not in ANGLES for one, _ in derived),
    )


def _moving(
    trace: Trace, profile: ProfileData, torque: FloatArray, masked: NDArray[np.bool_]
) -> tuple[tuple[Fault, ...], Trace, tuple[tuple[str, str], ...]]:
    """Return faults of angle, tacho and clock, the trace without them, and what is derived."""
    shaft = shaft_of(trace, profile)
    if shaft is None:
        return (), trace, ()
    pair = derivation(shaft)
    torque = _rest(trace, profile, torque)
    ripple = Ripple(torque, ~masked, baseline_orders(profile), np.nan_to_num(shaft.velocity_rad_s))
    independent = pair is None and has_own_noise(shaft)
    # ripple of the tacho hides small jumps, and a jump turns the ripple's phase
    lines, smooth = find_tacho_ripple(trace, shaft) if independent else ((), trace)
    even = shaft_of(smooth, profile) if lines else shaft
    jumps, repaired = find_jumps(smooth, even or shaft, profile, ripple, independent=independent)
    lines = tuple(
        replace(one, undone=without_ripple(repaired, shaft.angle_rad, one.shape, -1))
        for one in lines
    )
    return (*jumps, *lines), repaired, () if pair is None else (pair,)


def _rest(trace: Trace, profile: ProfileData, torque: FloatArray) -> FloatArray:
    """Return the torque less what load and acceleration explain; 0 where it is lost."""
    out = np.nan_to_num(torque)
    velocity = velocity_of(trace, profile)
    if velocity is not None:
        inertia = profile.drive.load_inertia_kg_m2 / profile.drive.gear_ratio
        out = out - inertia * np.nan_to_num(velocity_slope(trace.time_s, velocity))
    if "load_torque_nm" in trace:
        out = out - np.nan_to_num(trace["load_torque_nm"])
    return np.asarray(out)


def _finite(trace: Trace) -> Trace:
    """Return the trace with infinite samples lost."""
    wrong = {
        name: np.where(np.isfinite(values), values, np.nan)
        for name, values in trace.columns.items()
        if name != "time_s" and bool(np.isinf(values).any())
    }
    return trace.with_columns(**wrong) if wrong else trace


def _at_rest(trace: Trace, profile: ProfileData) -> str:
    """Return why a record without any motion says nothing, or nothing."""
    parts = (angle_of(trace, profile), velocity_of(trace, profile))
    known = [part[np.isfinite(part)] for part in parts if part is not None]
    if not known or any(len(part) and float(np.ptp(part)) > 0.0 for part in known):
        return ""
    return "neither angle nor velocity changes by a single step: the record holds no motion"


def _known_out(trace: Trace, profile: ProfileData, model: BenchModel) -> Trace:
    """Return the trace without the faults of angle, tacho and clock that the model holds."""
    for term in model.causes:
        shape = dict(term.shape)
        angle = angle_of(trace, profile)
        if term.name == "tacho-ripple" and angle is not None:
            trace = without_ripple(trace, angle, shape)
        elif term.name in ("encoder-slip", "missed-samples"):
            first = int(np.searchsorted(trace.time_s, shape["step_time_s"]))
            if term.name == "encoder-slip":
                trace = turned_back(trace, profile, first, shape["slip_rad"])
            else:
                trace = later_from(trace, first, shape["missed_s"])
    return trace


def _isolated(values: FloatArray, least: float) -> NDArray[np.bool_]:
    """Return single samples far out of a course that is even on both sides of them."""
    out = np.zeros(len(values), dtype=bool)
    if len(values) < 10 * _WINDOW:
        return out
    known = np.nan_to_num(values)
    away = np.abs(known - median_filter(known, size=_WINDOW, mode="nearest"))
    limit = max(_OUT_RATIO * float(np.quantile(away, 0.99)), _OUT_SIGMA * robust_std(away), least)
    around = np.abs(known[np.array([[0], [1], [3], [4]]) + np.arange(len(known) - 4)] - known[2:-2])
    flat = around.max(axis=0) - around.min(axis=0) < _FLAT * around.min(axis=0)
    out[2:-2] = flat & (away[2:-2] > limit) & np.isfinite(values[2:-2])
    return out


def _without_glitches(trace: Trace, profile: ProfileData) -> tuple[Trace, tuple[DataFlag, ...]]:
    """Return the trace without isolated wrong samples of velocity and angle, and their flags."""
    flags: tuple[DataFlag, ...] = ()
    velocity, angle = velocity_of(trace, profile), angle_of(trace, profile)
    courses = []
    if velocity is not None:
        steps = np.abs(np.diff(velocity))
        # rounding of a motion without noise is no wrong sample
        step = float(np.min(steps, where=steps > 0.0, initial=np.inf))
        courses.append((VELOCITIES, velocity, velocity, _OUT_STEPS * step, "velocity"))
    if angle is not None:
        # a wrong angle is out for one move and back for the next; a slip stays out
        moves = np.nan_to_num(np.diff(angle, prepend=angle[:1]))
        off = moves - median_filter(moves, size=_WINDOW, mode="nearest")
        usual = float(np.quantile(np.abs(moves), 0.99))
        courses.append((ANGLES, angle, np.cumsum(off), usual, "motor angle"))
    for names, channel, course, least, what in courses:
        # nor has a reading that was held left its course
        wrong = _isolated(course, least) & (np.diff(channel, prepend=np.nan) != 0.0)
        # beside a gap there is none
        for at in gap_steps(trace.time_s).tolist():
            wrong[max(0, at - _WINDOW) : at + _WINDOW] = False
        trace = _lost_at(trace, names, wrong)
        flags += flag_samples("spikes", trace.time_s, wrong, f"isolated samples of the {what}")
    return trace, flags


def _lost_at(trace: Trace, names: tuple[str, ...], mask: NDArray[np.bool_]) -> Trace:
    """Return the trace with the marked samples of some channels lost."""
    if not mask.any():
        return trace
    kept = {name: np.where(mask, np.nan, trace[name]) for name in names if name in trace}
    return trace.with_columns(**kept)
