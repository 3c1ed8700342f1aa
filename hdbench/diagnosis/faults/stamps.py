"""Missed samples that the record shows itself: no value, a gap of the stamps, held readings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from hdbench.diagnosis.evidence import GAP
from hdbench.diagnosis.faults.fault import Fault
from hdbench.diagnosis.faults.scatter import (
    CERTAIN_NATS,
    STUCK,
    mask_runs,
    smallest_step,
    tail_nats,
)
from hdbench.model.motion import TORQUES
from hdbench.records.trace import FloatArray, Trace
from hdbench.results.diagnosis import ParameterValue

# scatter of the stamps, in periods, beyond which they follow no clock: where they are even over
# a period they have .475, and normal ones of a seventh of a period .3
_NO_CLOCK = 0.3
# samples on each side of a step whose earliest stamp tells what is missing
_BESIDE = 7
# changes on each side that tell how a channel moves, and a chance of no change that tells
_NEAR, _RARE = 5, 0.03
# channels that tell what the bench measured at a moment
_TOLD = (*TORQUES, "motor_velocity_rad_s", "tacho_v")

# a shaft turned on through a row if it turned by more than so many steps of its angle after it
_TURNS = 3.0


def gap_steps(time_s: FloatArray) -> NDArray[np.intp]:
    """Return the indices k where samples are missing between k and k + 1."""
    steps = np.diff(time_s)
    span = 2 * _BESIDE + 1
    if len(steps) < span:
        return np.flatnonzero(steps > GAP * np.median(steps)) if len(steps) else np.array([], int)
    part = steps / float(np.median(steps))
    jitter = float(np.quantile(np.abs(part - np.round(part)), 0.95))
    if jitter > _NO_CLOCK:
        return np.array([], int)
    # a log with stamps of a host has steps of three periods and more without a loss
    long = np.flatnonzero(part > max(GAP, 1.0 + 12.0 * jitter))
    # late stamps are made up for: the earliest ones on each side keep their places
    usual = float(np.median(time_s[span:] - time_s[:-span])) / span
    late = time_s / usual - np.arange(len(time_s))
    after = minimum_filter1d(late, _BESIDE, origin=-(_BESIDE // 2), mode="nearest")[1:]
    before = minimum_filter1d(late, _BESIDE, origin=_BESIDE // 2, mode="nearest")[:-1]
    return np.asarray(long[(after - before)[long] > 0.5])


def gaps_of(
    time_s: FloatArray, stage: FloatArray | None, at: NDArray[np.intp]
) -> list[tuple[float, float, int]]:
    """Return the stamps around each gap after `at`, and how many samples are missing."""
    steps = np.diff(time_s)
    period = float(np.median(steps[steps > 0.0]))
    # a pause between two stages of a plan is no gap: no sample was due there
    return [
        (float(time_s[k]), float(time_s[k + 1]), max(1, round(float(steps[k]) / period) - 1))
        for k in at.tolist()
        if stage is None or stage[k] == stage[k + 1]
    ]


def lost_samples(trace: Trace) -> tuple[Fault, ...]:
    """Return samples without a value and gaps of the stamps as one fault, if there are any."""
    time = trace.time_s
    runs = mask_runs(~trace.valid(*(name for name in _TOLD if name in trace)))
    places = [(float(time[a]), float(time[b]), b - a + 1) for a, b in runs]
    places += gaps_of(time, trace.columns.get("stage"), gap_steps(time))
    if not places:
        return ()
    first, last, counts = zip(*places, strict=True)
    parameters = {
        "samples": ParameterValue(sum(counts), 0.0, "1"),
        "stretches": ParameterValue(len(places), 0.0, "1"),
        "step_time_s": ParameterValue(min(first), None, "s"),
    }
    span = (sum(counts), min(first), max(last))
    return (Fault("missed-samples", parameters, *span, CERTAIN_NATS, 0.0),)


def repeated_rows(trace: Trace, angle: FloatArray | None) -> NDArray[np.bool_]:
    """Return rows that only repeat the one before although the shaft turns: samples held.

    A velocity says nothing of that: it may be made of the angles.
    """
    repeated = np.zeros(len(trace), dtype=bool)
    if angle is None:
        return repeated
    moves = np.diff(angle)
    same = moves == 0.0
    for other in (*TORQUES, "load_torque_nm", "motor_current_a"):
        if other in trace and same.any():
            same &= np.diff(trace[other]) == 0.0
    if not same.any():
        return repeated
    least = _TURNS * smallest_step(moves)
    for first, last in mask_runs(same):
        before, after = moves[max(first - 1, 0)], moves[min(last + 1, len(moves) - 1)]
        # a shaft that starts, stops or turns back within the row moves on one side alone
        if before * after > 0.0 and abs(after) > least:
            repeated[first + 1 : last + 2] = True
    return repeated


def held_samples(values: FloatArray, step: float, alpha: float) -> NDArray[np.bool_]:
    """Return the samples that repeat the one before although the channel moves."""
    held = np.zeros(len(values), dtype=bool)
    moves = np.diff(values)
    same = moves == 0.0
    if len(moves) <= 2 * _NEAR or not same.any() or same.all():
        return held
    sizes = np.abs(moves)
    # rounding twice hides a grid: the smallest change that is there is no less than it
    step = max(step, float(np.nanmin(sizes[sizes > 1e-9 * float(np.nanmax(sizes))])))
    # a normal change falls on 0 of a grid with the density there times the step
    windows = np.lib.stride_tricks.sliding_window_view(moves, 2 * _NEAR + 1)
    beside = np.delete(windows, _NEAR, axis=1)
    middle = np.median(beside, axis=1)
    spread = 1.4826 * np.median(np.abs(beside - middle[:, None]), axis=1) + 0.5 * step
    chance = np.ones(len(moves))
    chance[_NEAR:-_NEAR] = np.exp(-0.5 * (middle / spread) ** 2) / np.sqrt(2.0 * np.pi)
    chance[_NEAR:-_NEAR] *= step / spread
    rare = chance < _RARE
    # without any that are held, no change is as frequent as one step up or down
    steps = int((rare & ~same & (sizes < 1.5 * step)).sum())
    if tail_nats(int((same & rare).sum()), 0.5 * steps + 1.0) < -np.log(alpha):
        return held
    for first, last in mask_runs(same & rare):
        if last - first < STUCK:
            held[first + 1 : last + 2] = True
    return held
