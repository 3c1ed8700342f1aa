"""Jumps between angle and velocity: slips of the encoder, and samples that the stamps hide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, maximum_filter1d, minimum_filter1d

from hdbench.diagnosis.faults.fault import ACCEPT_NATS, TELL_NATS, Fault, entry, normal_tail
from hdbench.diagnosis.faults.phase import Ripple, jump_nats
from hdbench.diagnosis.faults.shaft import ANGLES, DELAYS, REACH, Shaft, disagreement
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = ["find_jumps", "later_from", "turned_back"]

# samples on each side: there the averaged counting of a 4000-count encoder meets the walk that the
# tacho's noise of 0.06 rad/s makes at 1 kHz
_SIDE = 14
# samples over which the scatter of the steps is taken, near in time and alike in motion; the share
# of them that no jump touches, and where it ends among normal values
_NEAR, _ALIKE = (400, 0.85, 1.44), (1200, 0.95, 1.96)
_ROUNDS = 3
# a counted angle is off by less than one count; 0.8 of one more is what bends within a period
_COUNTS = 1.8
# smallest jump, rad: it turns ripple of order 2 by a thousandth of its amplitude
_SMALLEST_RAD = 5e-4
# stamps may be wrong by twice as much as the oddest step around shows
_LATE = 2.0
# three intervals hold this part of a jump at least
_SUDDEN = 0.5
# jumps that are judged at most, the largest first
_MOST = 8
# times the nats that tell names apart a torque has to be able to say: its own scatter is then small
# beside what it says
_ABLE = 6.0
# a jump this many standard deviations from a whole number of samples is none of lost samples
_WHOLE_SIGMA = 4.0
# how well a large number of lost samples has to be known
_KNOWN = 0.1
# times the loss at the faster side's speed that a loss may last, and samples that it may have
_LONGEST, _MOST_LOST = 4.0, 5000


@dataclass(frozen=True, slots=True)
class Jump:
    """The angle moves against the velocity between samples `first` - 1 and `first`.

    `before` and `after` are velocity, rad/s, and acceleration, rad/s^2, on its two sides.
    """

    first: int
    angle_rad: float
    std_rad: float
    before: tuple[float, float]
    after: tuple[float, float]


def turned_back(trace: Trace, profile: ProfileData, first: int, angle_rad: float) -> Trace:
    """Return the trace with its measured angle less `angle_rad` from one sample on."""
    count = profile.encoder.counts_per_turn / (2.0 * np.pi)
    columns = {}
    for name, scale in zip(ANGLES, (1.0, count), strict=True):
        if name in trace:
            columns[name] = trace[name].copy()
            columns[name][first:] -= angle_rad * scale
    return trace.with_columns(**columns)


def later_from(trace: Trace, first: int, delay_s: float) -> Trace:
    """Return the trace with every sample from one on later by `delay_s`."""
    time = trace.time_s.copy()
    time[first:] += delay_s
    return trace.with_columns(time_s=time)


def find_jumps(
    trace: Trace, shaft: Shaft, profile: ProfileData, ripple: Ripple, *, independent: bool
) -> tuple[tuple[Fault, ...], Trace]:
    """Return the jumps that evidence names, in order of time, and the trace without them.

    With a slip the torque's ripple goes on over the angle turned back; with lost samples it goes
    on over the recorded angle, and the jump is a whole number of samples' turning. Two sensors
    that disagree are evidence enough where the torque cannot tell; of two channels of one sensor
    only the torque can.
    """
    jumps = sorted(_found(shaft), key=lambda jump: -abs(jump.angle_rad))[:_MOST]
    places = sorted([0, len(trace), *(jump.first for jump in jumps)])
    named: list[tuple[Jump, str, int, float]] = []
    for jump in jumps:
        where = places.index(jump.first)
        ends = (places[where - 1], places[where + 1])
        nats, able = jump_nats(ripple, shaft.angle_rad, jump.first, jump.angle_rad, ends)
        # of two sensors the torque has to agree where it is able to
        agrees = TELL_NATS if able > _ABLE * TELL_NATS else -TELL_NATS
        needed = agrees if independent else ACCEPT_NATS
        count, std, near = _lost_samples(jump, shaft.period_s, shaft.count_rad)
        lost = -nats > needed and (near or (independent and count > 0 and nats < -TELL_NATS))
        if nats > needed:
            # a whole number of samples' turning, and the torque hardly tells
            both = near and nats < max(ACCEPT_NATS, 0.5 * able)
            named.append((jump, "both" if both else "encoder-slip", count, std))
        elif lost:
            named.append((jump, "missed-samples", count, std))
    # later losses first: a loss moves the stamps of all samples after it
    named.sort(key=lambda one: -one[0].first)

    def repaired(every: list[tuple[Jump, str, int, float]]) -> Trace:
        out = trace
        for jump, name, count, _ in every:
            if name == "encoder-slip":
                out = turned_back(out, profile, jump.first, jump.angle_rad)
            else:
                out = later_from(out, jump.first, count * shaft.period_s)
        return out

    faults = (
        _fault(one, shaft, repaired([other for other in named if other is not one]))
        for one in reversed(named)
    )
    return tuple(faults), repaired(named)


def _fault(named: tuple[Jump, str, int, float], shaft: Shaft, undone: Trace) -> Fault:
    jump, name, samples, std = named
    time, count = shaft.time_s, len(shaft.time_s)
    place = 0.5 * float(time[jump.first - 1] + time[jump.first])
    tail = normal_tail(jump.angle_rad / jump.std_rad, count, 3, count)
    parameters = {"step_time_s": entry(place, None, "s")}
    if name != "missed-samples":
        parameters["slip_rad"] = entry(jump.angle_rad, jump.std_rad, "rad")
    used = ("torque_nm", *shaft.names)
    if name == "encoder-slip":
        shape = {"slip_rad": jump.angle_rad, "step_time_s": place}
        span = (count - jump.first, float(time[jump.first]), float(time[-1]))
        return Fault(name, parameters, *span, *tail, used, shape, undone=undone)
    missed = samples * shaft.period_s
    parameters["samples"] = entry(samples, std, "1")
    parameters["missed_s"] = entry(missed, std * shaft.period_s, "s")
    span = (samples, float(time[jump.first - 1]), float(time[jump.first]))
    shape = {"missed_s": missed, "step_time_s": place}
    group = ("encoder-slip",) if name == "both" else ()
    return Fault("missed-samples", parameters, *span, *tail, used, shape, group, undone=undone)


def _steps(lefts: list[FloatArray]) -> FloatArray:
    """Return the mean level after less that before each increment, as far as all agree."""
    out = np.zeros(0)
    for left in lefts:
        total = np.concatenate([[0.0], np.cumsum(left)])
        sums = np.concatenate([[0.0], np.cumsum(total)])
        at = np.arange(len(left))
        low, high = np.maximum(at + 1 - _SIDE, 0), np.minimum(at + 1 + _SIDE, len(left) + 1)
        before = (sums[at + 1] - sums[low]) / (at + 1 - low)
        step = (sums[high] - sums[at + 1]) / (high - at - 1) - before
        least = np.minimum(np.abs(out), np.abs(step)) if len(out) else step
        out = np.where(out * step > 0.0, np.sign(step) * least, 0.0) if len(out) else step
    return np.asarray(out)


def _scatter(shaft: Shaft, steps: FloatArray, good: NDArray[np.bool_]) -> FloatArray:
    """Return the scatter of the steps at each increment: of those near in time, and as fast.

    Where the velocity changes as fast as here, or is as large, the steps show what its filter and
    the stamps are wrong by.
    """
    pace = np.abs(np.nan_to_num(shaft.velocity_rad_s))
    change = maximum_filter1d(pace, 2 * _SIDE + 1) - minimum_filter1d(pace, 2 * _SIDE + 1)
    out = np.full(len(steps), 1e-12)
    at = np.flatnonzero(good)
    for key, (count, share, sigma) in ((at, _NEAR), (pace[at], _ALIKE), (change[at], _ALIKE)):
        ranked = at[np.argsort(key, kind="stable")]
        parts = np.array_split(np.abs(steps[ranked]), max(1, len(at) // count))
        sizes = np.array([float(np.quantile(part, share)) / sigma for part in parts])
        # the fastest are few: nothing is quieter than what is slower
        sizes = sizes if key is at else np.maximum.accumulate(sizes)
        wide = np.repeat(sizes, [len(part) for part in parts])
        out[ranked] = np.maximum(out[ranked], wide)
    return out


def _least(shaft: Shaft) -> FloatArray:
    """Return the step that counting, late stamps and the integration make, rad."""
    steps = shaft.steps_s
    least = max(_COUNTS * shaft.count_rad, _SMALLEST_RAD)
    odd = np.where(shaft.good, np.abs(steps - shaft.period_s), 0.0)
    late = maximum_filter1d(odd, 2 * _SIDE + 1)
    velocity = np.nan_to_num(shaft.velocity_rad_s)
    pace = np.abs(0.5 * (velocity[1:] + velocity[:-1]))
    # a velocity that was held is off by what it changes by around
    held = np.diff(velocity, append=np.nan) == 0.0
    change = maximum_filter1d(velocity, 5) - minimum_filter1d(velocity, 5)
    beyond = np.where(held, change, 0.0)
    unknown = np.convolve((beyond[1:] + beyond[:-1]) * steps, np.ones(3), mode="same")
    return np.asarray(np.maximum(least, _LATE * late * pace) + unknown)


def _whole(shaft: Shaft) -> NDArray[np.bool_]:
    """Return the increments around which the velocity is whole: no gap or end within its cells."""
    good = ~binary_dilation(~shaft.good, iterations=REACH)
    good[: DELAYS + REACH] = False
    good[len(good) - DELAYS - REACH :] = False
    return np.asarray(good)


def _found(shaft: Shaft) -> list[Jump]:
    """Return the moments where angle and velocity part for good within three samples."""
    good = _whole(shaft)
    if int(good.sum()) < 4 * _SIDE:
        return []
    # at one speed noise makes a free filter wider than it is, and a plain one knows no filter: a
    # jump is what neither explains
    lefts = [np.where(good, disagreement(shaft, free=free), 0.0) for free in (False, True)]
    scatter = _scatter(shaft, _steps(lefts), good)
    count = len(good)
    sigmas = float(np.sqrt(2.0 * (ACCEPT_NATS + 1.5 * np.log(count))))
    floor = np.maximum(sigmas * scatter, _least(shaft))
    sizes = np.zeros(count)
    for _ in range(_ROUNDS):
        # one jump within reach of another is what is left of it
        near = binary_dilation(sizes != 0.0, iterations=_SIDE)
        found = _peaks([left - sizes for left in lefts], floor, good & ~near)
        for at, size in found:
            sizes[at] = size
        if not found:
            break
    return [
        Jump(
            at + 1, float(sizes[at]), max(float(scatter[at]), 1e-12),
            _pace(shaft, at, -1), _pace(shaft, at + 1, 1),
        )
        for at in np.flatnonzero(np.abs(sizes) > floor).tolist()
    ]  # fmt: skip


def _peaks(
    lefts: list[FloatArray], floor: FloatArray, good: NDArray[np.bool_]
) -> list[tuple[int, float]]:
    """Return place and size of the largest sudden step in each stretch where steps stand out."""
    steps, left = _steps(lefts), lefts[0]
    inside = np.zeros(len(steps), dtype=bool)
    inside[_SIDE:-_SIDE] = True
    far = np.flatnonzero(good & inside & (np.abs(steps) > floor))
    if not len(far):
        return []
    around = np.convolve(left, np.ones(3), mode="same")
    peaks = []
    for part in np.split(far, np.flatnonzero(np.diff(far) > _SIDE) + 1):
        at = int(part[np.argmax(np.abs(steps[part]) + np.abs(left[part]))])
        # a ramp, such as a filter's, spreads over many intervals
        if around[at] * steps[at] > 0.0 and abs(around[at]) > _SUDDEN * abs(steps[at]):
            peaks.append((at, float(steps[at])))
    return peaks


def _pace(shaft: Shaft, at: int, side: int) -> tuple[float, float]:
    """Return velocity and acceleration at a sample by a line through those on one side of it."""
    rows = at + side * np.arange(_SIDE)
    rows = rows[(rows >= 0) & (rows < len(shaft.time_s))]
    rows = rows[np.isfinite(shaft.velocity_rad_s[rows])]
    if len(rows) < 2:
        return 0.0, 0.0
    time = shaft.time_s[rows] - shaft.time_s[at]
    slope, level = np.polyfit(time, shaft.velocity_rad_s[rows], 1)
    return float(level), float(slope)


def _lost_samples(jump: Jump, period_s: float, count_rad: float) -> tuple[int, float, bool]:
    """Return how many lost samples turn by a jump, how well that is known, and whether it fits.

    None where the shaft went the other way. In between the speed follows the cubic that has speed
    and acceleration of both sides.
    """
    (speed, slope), (later, later_slope) = jump.before, jump.after
    fastest = max(abs(speed), abs(later))
    if not fastest > 0.0:
        return 0, 0.0, False
    most = int(_LONGEST * abs(jump.angle_rad) / (fastest * period_s)) + 1
    time = period_s * np.arange(1, min(most, _MOST_LOST) + 1)
    turned = 0.5 * (speed + later) * time + (slope - later_slope) * time**2 / 12.0
    away = np.abs(jump.angle_rad - turned)
    best = int(np.argmin(away))
    if not turned[best] * jump.angle_rad > 0.0:
        return 0, 0.0, False
    # the course of the speed in between is not known: half of the bend's share
    bend = 0.5 * abs((slope - later_slope) * time[best] ** 2 / 12.0)
    near = away[best] < _WHOLE_SIGMA * jump.std_rad + 0.5 * count_rad + bend
    std = (bend + away[best]) / max(abs(0.5 * (speed + later)) * period_s, 1e-12)
    return best + 1, float(min(std, best + 1)), bool(near and std < max(1.0, _KNOWN * best))
