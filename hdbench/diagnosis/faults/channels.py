"""Channels of a trace: what can be trusted, what takes no part, and which faults have a name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter

from hdbench.diagnosis.faults.converter import CHANCE, clipping, stuck_samples
from hdbench.diagnosis.faults.fault import Fault, Inspected, flag_runs, flag_samples
from hdbench.diagnosis.faults.jumps import find_jumps
from hdbench.diagnosis.faults.scatter import bridged, find_outliers, smallest_step
from hdbench.diagnosis.faults.shaft import (
    ANGLES,
    VELOCITIES,
    derivation,
    has_own_noise,
    shaft_of,
    standing,
    velocity_of,
    without_faults,
)
from hdbench.diagnosis.faults.stamps import (
    held_samples,
    lost_samples,
    repeated_rows,
)
from hdbench.diagnosis.faults.tacho import find_tacho_ripple
from hdbench.diagnosis.faults.units import check_channels, expected_nm
from hdbench.model import BenchModel, baseline_orders
from hdbench.model.localfit import filled
from hdbench.model.motion import TORQUES, torque_from_trace
from hdbench.profile.scaling import angle_channel
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace
from hdbench.results.diagnosis import StretchFlag

# samples on each side whose median a velocity has that does not jump: differences of up to so many
# samples have taken the jump in
_STEADY = 7


def inspect_channels(
    trace: Trace, profile: ProfileData, model: BenchModel, *, alpha: float
) -> Inspected:
    """Inspect every channel of a trace before a fit; `DataError` where it has no torque."""
    if len(trace) < 5:
        reason = f"{len(trace)} samples; needed: at least 5"
        return Inspected(trace, np.zeros(len(trace), dtype=bool), reason=reason)
    checked = check_channels(_finite(trace), profile)
    trace, reason = checked.trace, checked.reason or _at_rest(checked.trace, profile)
    if reason:
        return replace(checked, reason=reason)
    torque, lost = torque_from_trace(trace, profile), lost_samples(trace)
    known = [(term.name, dict(term.shape)) for term in model.causes]
    # faults that the model holds are taken out and not found again
    trace, glitches = _without_glitches(without_faults(trace, profile, known), profile)
    clipped, saturation = clipping(trace, profile, torque)
    stuck = stuck_samples(torque) & ~clipped
    angle = angle_channel(trace, profile)
    stale = repeated_rows(trace, angle)
    held = (stale | held_samples(torque, 0.0, CHANCE)) & ~(clipped | stuck)
    known_so_far = clipped | stuck | held
    still = standing(trace, profile, np.where(known_so_far, np.nan, torque)) & ~known_so_far
    masked = known_so_far | still
    # what stands in for a held row lies between the counts of the angle
    count_rad = 0.0 if angle is None else smallest_step(np.diff(angle))
    # a row that was held says nothing of the motion, either
    other = [n for n in trace.columns if n not in ("time_s", "stage", *TORQUES)]
    trace = trace.with_columns(**{n: filled(trace.time_s, trace[n], stale) for n in other})
    unmasked = np.where(masked, np.nan, torque)
    moving, repaired, derived = _moving(trace, profile, unmasked, count_rad)
    if any(one.false_alarm_probability >= alpha for one in moving):
        moving, repaired = (), trace
    faults = (*lost, *saturation, *moving)
    of_held = "torque that repeats the reading before; left out"
    flags = (
        *checked.flags,
        *flag_runs("stuck-value", trace.time_s, stuck),
        *glitches,
        *flag_samples("missed-samples", trace.time_s, held, of_held),
        *(fault.flag() for fault in faults),
    )
    reasons = {"no value": ~np.isfinite(torque), "clipped": clipped, "stuck": stuck}
    reasons |= {"held": held, "standstill": still}
    return Inspected(
        repaired,
        masked,
        tuple((name, int(mask.sum())) for name, mask in reasons.items() if mask.any()),
        tuple(sorted(flags, key=lambda flag: flag.from_s)),
        faults,
        derived=derived,
    )


def _moving(
    trace: Trace, profile: ProfileData, torque_nm: FloatArray, count_rad: float
) -> tuple[tuple[Fault, ...], Trace, tuple[tuple[str, str], ...]]:
    """Return faults of angle, tacho and clock, the trace without them, and what is derived."""
    shaft = shaft_of(trace, profile)
    if shaft is None:
        return (), trace, ()
    pair = derivation(shaft)
    independent = pair is None and has_own_noise(shaft)
    # ripple of the tacho hides small jumps, and a jump turns the ripple's phase
    faults = find_tacho_ripple(shaft) if independent else ()
    smooth = without_faults(trace, profile, [(one.name, one.shape) for one in faults])
    if pair is not None and pair[0] in VELOCITIES:
        # a velocity that was made of the angle jumps with it
        steady = median_filter(bridged(smooth[pair[0]]), 2 * _STEADY + 1)
        smooth = smooth.with_columns(**{pair[0]: steady})
    load = trace.columns.get("load_torque_nm", np.zeros(len(trace)))
    rest = torque_nm - np.nan_to_num(expected_nm(trace, profile, shaft.velocity_rad_s) + load)
    even, orders = shaft_of(smooth, profile) or shaft, baseline_orders(profile)
    even = replace(even, count_rad=max(even.count_rad, count_rad))
    faults = (*find_jumps(even, orders, rest, independent=independent), *faults)

    def without(kept: Fault | None) -> Trace:
        out = [(one.name, one.shape) for one in faults if one is not kept]
        return without_faults(trace, profile, out)

    told = tuple(replace(one, undone=without(one)) for one in faults)
    return told, without(None), () if pair is None else (pair,)


def _finite(trace: Trace) -> Trace:
    """Return the trace with infinite samples lost."""
    wrong = {
        name: np.where(np.isfinite(values), values, np.nan)
        for name, values in trace.columns.items()
        if name != "time_s" and bool(np.isinf(values).any())
    }
    return trace.with_columns(**wrong)


def _at_rest(trace: Trace, profile: ProfileData) -> str:
    """Return why a record without any motion says nothing, or nothing."""
    parts = (angle_channel(trace, profile), velocity_of(trace, profile))
    known = [part[np.isfinite(part)] for part in parts if part is not None]
    if not known or any(len(part) and float(np.ptp(part)) > 0.0 for part in known):
        return ""
    return "neither angle nor velocity changes by a single step: the record holds no motion"


def _without_glitches(trace: Trace, profile: ProfileData) -> tuple[Trace, tuple[StretchFlag, ...]]:
    """Return the trace without isolated wrong samples of velocity and angle, and their flags."""
    flags: tuple[StretchFlag, ...] = ()
    velocity, angle = velocity_of(trace, profile), angle_channel(trace, profile)
    courses = []
    if velocity is not None:
        # rounding makes one or two of the channel's smallest steps
        rounding = 4.0 * smallest_step(velocity)
        courses.append((VELOCITIES, velocity, velocity, rounding, "velocity"))
    if angle is not None:
        # a wrong angle is out for one move and back for the next; a slip stays out
        moves = np.nan_to_num(np.diff(angle, prepend=angle[:1]))
        course = np.cumsum(moves - median_filter(moves, size=5, mode="nearest"))
        usual = float(np.quantile(np.abs(moves), 0.99))
        courses.append((ANGLES, angle, course, usual, "motor angle"))
    for names, channel, course, least, what in courses:
        # an isolated wrong sample leaves a course that is five times as even beside it
        wrong = find_outliers(course, np.isfinite(channel), course, least=least, even=5.0)
        # a reading that was held has not left its course
        wrong &= np.diff(channel, prepend=np.nan) != 0.0
        lost = {name: np.where(wrong, np.nan, trace[name]) for name in names if name in trace}
        trace = trace.with_columns(**lost)
        flags += flag_samples("spikes", trace.time_s, wrong, f"isolated samples of the {what}")
    return trace, flags
