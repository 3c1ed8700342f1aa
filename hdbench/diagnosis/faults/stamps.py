"""Missed samples that the record shows itself: no value, a gap of the stamps, a row held."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.faults.fault import Fault, entry, mask_runs
from hdbench.records.trace import FloatArray, Trace

__all__ = ["gap_steps", "lost_samples", "repeated_rows"]

# a step longer than this many median periods is a gap: one lost sample makes 2
_GAP = 1.5
# and this many times as long as 19 of 20 stamps are off a whole number of periods: a log with
# stamps of a host has steps of three periods and more without a loss
_JITTER = 12.0
# samples on each side whose earliest tells what is missing, and how much has to be, periods
_AROUND = 7
_MISSING = 0.5
# channels that tell whether a row is the one before: what the bench measured at that moment
_MEASURED = (
    "torque_nm", "torque_v", "motor_velocity_rad_s", "tacho_v", "load_torque_nm",
    "motor_current_a",
)  # fmt: skip
_ANGLES = ("encoder_count", "motor_angle_rad")
# an angle that moves by less than this many of its smallest steps may well read the same twice
_MOVES = 5.0
# slower than this part of the usual pace the shaft may start or stop within the row
_PACE = 0.2
# what the stamps say themselves needs no statistic: a finite number that nothing reaches
_CERTAIN_NATS = 700.0


def gap_steps(time_s: FloatArray) -> NDArray[np.intp]:
    """Return the indices k where samples are missing between k and k + 1."""
    steps = np.diff(time_s)
    if not len(steps):
        return np.zeros(0, dtype=np.intp)
    period = float(np.median(steps))
    part = steps / period
    jitter = float(np.quantile(np.abs(part - np.round(part)), 0.95))
    long = np.flatnonzero(part > max(_GAP, 1.0 + _JITTER * jitter))
    if not len(long):
        return long
    # late stamps are made up for: the earliest ones on each side keep their places
    spans = time_s[2 * _AROUND + 1 :] - time_s[: -2 * _AROUND - 1]
    usual = float(np.median(spans)) / (2 * _AROUND + 1) if len(spans) else period
    late = time_s / usual - np.arange(len(time_s))
    sides = [(late[max(0, k + 1 - _AROUND) : k + 1], late[k + 1 : k + 1 + _AROUND]) for k in long]
    missing = np.array([float(after.min() - before.min()) for before, after in sides])
    return np.asarray(long[missing > _MISSING])


def lost_samples(trace: Trace) -> tuple[Fault, ...]:
    """Return samples without a value and gaps of the stamps as one fault, if there are any.

    A pause between two stages of a plan is no gap: no sample was due there.
    """
    time = trace.time_s
    names = [n for n in ("torque_nm", "torque_v", "motor_velocity_rad_s", "tacho_v") if n in trace]
    runs = mask_runs(~trace.valid(*names))
    places = [(float(time[a]), float(time[b]), b - a + 1) for a, b in runs]
    steps = np.diff(time)
    period = float(np.median(steps)) if len(steps) else 0.0
    stage = trace.columns.get("stage")
    for at in gap_steps(time).tolist():
        if stage is None or stage[at] == stage[at + 1]:
            lost = max(1, round(float(steps[at]) / period) - 1)
            places.append((float(time[at]), float(time[at + 1]), lost))
    if not places:
        return ()
    count, first = sum(place[2] for place in places), min(place[0] for place in places)
    parameters = {
        "samples": entry(count, 0.0, "1"),
        "stretches": entry(len(places), 0.0, "1"),
        "step_time_s": entry(first, None, "s"),
    }
    last = max(place[1] for place in places)
    fault = Fault("missed-samples", parameters, count, first, last, _CERTAIN_NATS, 0.0, ("time_s",))
    return (fault,)


def repeated_rows(trace: Trace) -> NDArray[np.bool_]:
    """Return rows that only repeat the one before although the shaft turns: samples held."""
    repeated = np.zeros(len(trace), dtype=bool)
    name = next((name for name in _ANGLES if name in trace), None)
    if name is None or len(trace) < 4:
        return repeated
    angle = trace[name]
    moves = np.diff(angle)
    same = moves == 0.0
    for other in _MEASURED:
        if other in trace and same.any():
            same &= np.diff(trace[other]) == 0.0
    turning = np.abs(moves[np.isfinite(moves) & (moves != 0.0)])
    if not same.any() or not len(turning):
        return repeated
    sizes = np.unique(turning)
    smallest = float(min(sizes[0], np.diff(sizes).min() if len(sizes) > 1 else sizes[0]))
    least = max(_MOVES * smallest, _PACE * float(np.median(turning)))
    for first, last in mask_runs(same):
        low, high = max(0, first - 1), min(len(angle) - 1, last + 2)
        # what the rows before and after have turned by, shared out over the steps between them
        if abs(float(angle[high] - angle[low])) / (high - low) >= least:
            repeated[first + 1 : last + 2] = True
    return repeated
