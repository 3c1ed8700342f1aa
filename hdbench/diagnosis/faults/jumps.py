"""Jumps between angle and velocity: slips of the encoder, and samples that the stamps hide."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, maximum_filter1d, minimum_filter1d

from hdbench.diagnosis.evidence import LEAST_DOF, RIVAL_NATS
from hdbench.diagnosis.faults.fault import Fault, fault_over
from hdbench.diagnosis.faults.scatter import ACCEPT_NATS, AROUND, least_sigmas, paid_nats
from hdbench.diagnosis.faults.shaft import Shaft, disagreement
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import ParameterValue

# samples on each side: there the averaged counting of a 4000-count encoder meets the walk that the
# tacho's noise of 0.06 rad/s makes at 1 kHz
_SIDE = 14
# whole motor turns on each side of a jump: enough for the scatter of the ripple's phase, few enough
# for a bench that changes slowly
_TURNS = 40
# coefficients of a slow course over these turns: a wave once per output turn is followed
_COURSE = 5
# a change of speed anywhere within a loss turns by up to a half of itself times the loss more or
# less than one in its middle; a standard deviation is half of that
_WITHIN = 0.25
# jumps that are judged at most, the largest first
_MOST = 8


@dataclass(frozen=True, slots=True)
class Jump:
    """The angle moves against the velocity between samples `first` - 1 and `first`."""

    first: int
    angle_rad: float
    std_rad: float
    name: str = ""  # what it is taken for
    group: tuple[str, ...] = ()
    samples: int = 0  # lost ones that turn by it
    samples_std: float = 0.0


def find_jumps(
    shaft: Shaft, orders: tuple[float, ...], torque_nm: FloatArray, *, independent: bool
) -> tuple[Fault, ...]:
    """Return the jumps that evidence names, in order of time; torque that takes no part is NaN.

    After a slip the ripple goes on over the angle turned back, after lost samples over the recorded
    one. Two sensors that disagree are evidence enough where the torque cannot tell.
    """
    jumps = sorted(_found(shaft), key=lambda jump: -abs(jump.angle_rad))[:_MOST]
    jumps.sort(key=lambda jump: jump.first)
    ends = [0, *(jump.first for jump in jumps), len(torque_nm)]
    faults = []
    for jump, start, stop in zip(jumps, ends, ends[2:], strict=False):
        alone = np.full(len(torque_nm), np.nan)
        alone[start:stop] = torque_nm[start:stop]
        judged = _judged(jump, shaft, alone, np.array(orders), independent)
        if judged.name:
            faults.append(_fault(judged, shaft))
    return tuple(faults)


def _judged(
    jump: Jump, shaft: Shaft, torque_nm: FloatArray, orders: FloatArray, independent: bool
) -> Jump:
    """Return the jump with the name that the evidence gives it, if any."""
    # positive where the ripple keeps its phase over the angle turned back (a slip), negative where
    # it does over the recorded angle (the shaft did turn)
    nats, able = _torque_nats(jump, shaft, torque_nm, orders, course=not independent)
    # of two sensors the torque has to agree where it is able to: where it could say six times what
    # tells names apart, its own scatter is small beside that
    agrees = RIVAL_NATS if able > 6.0 * RIVAL_NATS else -RIVAL_NATS
    needed = agrees if independent else ACCEPT_NATS
    samples, std, fits, near = _lost_samples(jump, shaft)
    # what a sample too many turns by is no slip until the torque says so
    needed = ACCEPT_NATS if near and samples < 0 else needed
    jump = replace(jump, samples=max(0, samples), samples_std=std)
    if nats > needed:
        # a whole number of samples' turning, and the torque hardly tells; beside a standstill any
        # number may have turned so
        unsure = fits and samples > 0 and nats < max(ACCEPT_NATS, 0.5 * able)
        if unsure and near:
            return replace(jump, name="missed-samples", group=("encoder-slip",))
        return replace(jump, name="encoder-slip", group=("missed-samples",) if unsure else ())
    if samples > 0 and -nats > needed and (near or (independent and nats < -RIVAL_NATS)):
        return replace(jump, name="missed-samples")
    return jump


def _fault(jump: Jump, shaft: Shaft) -> Fault:
    time, count = shaft.time_s, len(shaft.time_s)
    place = 0.5 * float(time[jump.first - 1] + time[jump.first])
    nats = paid_nats(0.5 * (jump.angle_rad / jump.std_rad) ** 2, 3, count)
    slip = {"slip_rad": ParameterValue(jump.angle_rad, jump.std_rad, "rad")}
    parameters = {"step_time_s": ParameterValue(place, None, "s")}
    if jump.name == "encoder-slip":
        shape = {"slip_rad": jump.angle_rad, "step_time_s": place}
        fault = fault_over(jump.name, parameters | slip, time[jump.first :], nats, shape=shape)
        return replace(fault, group=jump.group)
    missed = jump.samples * shaft.period_s
    parameters |= slip if jump.group else {}
    parameters["samples"] = ParameterValue(jump.samples, jump.samples_std, "1")
    parameters["missed_s"] = ParameterValue(missed, jump.samples_std * shaft.period_s, "s")
    around = time[jump.first - 1 : jump.first + 1]
    shape = {"missed_s": missed, "step_time_s": place}
    fault = fault_over(jump.name, parameters, around, nats, shape=shape)
    return replace(fault, samples=jump.samples, group=jump.group)


def _torque_nats(
    jump: Jump, shaft: Shaft, torque_nm: FloatArray, orders: FloatArray, *, course: bool
) -> tuple[float, float]:
    """Return the nats by which the torque prefers the angle turned back, and the most it can.

    Where the torque alone tells, the ripple may follow a slow course beside the jump, as errors of
    the angle make one.
    """
    angle = shaft.angle_rad
    moves = np.abs(np.nan_to_num(np.diff(angle, prepend=angle[:1])))
    moves[jump.first] = 0.0
    turns = np.cumsum(moves) / (2.0 * np.pi)
    turns -= turns[jump.first]
    later = np.arange(len(angle)) >= jump.first
    block = np.where(later, np.floor(turns), -1.0 - np.floor(-turns))
    block[~np.isfinite(torque_nm + angle)] = np.nan
    found, speeds, variances, numbers = [], [], [], []
    for number in range(-_TURNS, _TURNS):
        rows = np.flatnonzero(block == number)
        # ripple is read from four samples of a turn for each order
        if len(rows) < 4 * max(2, len(orders)):
            continue
        waves = np.exp(1j * angle[rows, None] * orders)
        line = np.linspace(-1.0, 1.0, len(rows))
        design = np.column_stack([np.ones(len(rows)), line, waves.real, waves.imag])
        solution = np.linalg.lstsq(design, torque_nm[rows], rcond=None)[0]
        left = torque_nm[rows] - design @ solution
        # a cos + b sin = Re (a - i b) exp(i angle)
        cosines, sines = np.split(solution[2:], 2)
        found.append(cosines - 1j * sines)
        speeds.append(float(np.mean(np.nan_to_num(shaft.velocity_rad_s[rows]))))
        variances.append(2.0 * float(left @ left) / len(rows) ** 2)
        numbers.append(number)
    turn_number = np.array(numbers, dtype=np.float64)
    late = turn_number >= 0.0
    if min(int(late.sum()), int((~late).sum())) < LEAST_DOF:
        return 0.0, 0.0
    # their scatter about a level and a slope over the velocity, which is what delays make, is the
    # noise, whatever its colour; a turn with something else counts as little as its own fit is bad
    amplitudes, variance = np.array(found), np.array(variances)
    weights = 1.0 / np.sqrt(variance + float(np.median(variance)) + 1e-300)
    speed = np.array(speeds) / max(*np.abs(speeds), 1e-300)
    slow = np.vander(turn_number / _TURNS, _COURSE if course else 1)
    design = weights[:, None] * np.column_stack([speed, slow])
    free = len(found) - design.shape[1]
    turn = np.exp(1j * orders * jump.angle_rad)
    both = np.hstack([amplitudes, np.where(late[:, None], amplitudes * turn, amplitudes)])
    wanted = weights[:, None] * both
    solution = np.linalg.lstsq(design.astype(complex), wanted, rcond=None)[0]
    misfit = np.maximum(np.sum(np.abs(wanted - design @ solution) ** 2, axis=0), 1e-300)
    as_is, back = np.split(misfit, 2)
    shared = float(np.sum(weights**2)) * float(late.mean() * (1.0 - late.mean()))
    size = np.median(np.abs(amplitudes), axis=0) * np.abs(turn - 1.0)
    able = np.log1p(size**2 * shared / np.minimum(as_is, back))
    return free * float(np.sum(np.log(as_is / back))), free * float(able.sum())


def _lost_samples(jump: Jump, shaft: Shaft) -> tuple[int, float, bool, bool]:
    """Return how many lost samples turn by a jump, how well that is known, if it fits and is sure.

    Fewer than none: the stamps count more samples than there was time for.
    """
    at = np.arange(_SIDE)
    (gone, before), (gained, after) = (
        np.polyfit(at, shaft.velocity_rad_s[rows], 1).tolist()
        for rows in (jump.first - 1 - at, jump.first + at)
    )
    # samples that a loss may have
    number = np.arange(-5000, 5000 + 1)
    number = number[number != 0]
    # the cubic that has speed and acceleration of both sides; half of its bend is not known
    bends = -shaft.period_s * (gone + gained) * number**2 / 12.0
    turned = 0.5 * shaft.period_s * (before + after) * number + bends
    # nor is where within the loss the speed changed by what neither side shows
    missing = np.abs(after - before - 0.5 * (gained - gone) * number)
    unsure = 0.5 * np.abs(bends) + _WITHIN * shaft.period_s * np.abs(number) * missing
    away = np.abs(jump.angle_rad - turned)
    fitting = (away < 4.0 * jump.std_rad + 0.5 * shaft.count_rad + unsure) & (
        turned * jump.angle_rad > 0.0
    )
    # where half may be anything, a number says nothing
    fitting &= unsure < 0.5 * np.abs(turned)
    best = int(np.argmin(away))
    if fitting.any():
        # beside a standstill very different numbers fit: the fewest are the likeliest
        fitting &= np.abs(number) <= 2 * int(np.abs(number[fitting]).min())
        best = int(np.argmin(np.where(fitting, away, np.inf)))
    samples = int(number[best])
    if not turned[best] * jump.angle_rad > 0.0:
        return 0, 0.0, False, False
    one = abs(float(turned[best]) / samples)
    std = min(float(unsure[best] + away[best]) / one, float(abs(samples)))
    allowed = max(1.0, 0.1 * (abs(samples) - 1))
    alone = bool(np.all(np.abs(number[fitting] - samples) <= 2.0 * allowed))
    return samples, std, bool(fitting[best]), bool(fitting[best] and alone and std < allowed)


def _found(shaft: Shaft) -> list[Jump]:
    """Return the moments where angle and velocity part for good within three samples."""
    # next to a gap or an end there is no level to compare with
    good = ~binary_dilation(~shaft.good, iterations=_SIDE)
    good[: 4 * _SIDE] = good[len(good) - 4 * _SIDE :] = False
    if int(good.sum()) < 4 * _SIDE:
        return []
    left = np.where(good, disagreement(shaft), 0.0)
    scatter = _scatter(shaft, _steps(left), good)
    # a counted angle is off by less than one count; 0.8 of one more is what bends within a period.
    # 5e-4 rad turn ripple of order 2 by a thousandth of its amplitude
    least = max(1.8 * shaft.count_rad, 5e-4)
    floor = np.maximum(least_sigmas(len(good)) * scatter, least)
    sizes = np.zeros(len(good))
    while int(np.count_nonzero(sizes)) < _MOST:
        # one jump within reach of another is what is left of it
        near = binary_dilation(sizes != 0.0, iterations=_SIDE)
        found = _peaks(left - sizes, floor, good & ~near)
        for at, size in found:
            sizes[at] = size
        if not found:
            break
    return [
        Jump(at + 1, float(sizes[at]), float(scatter[at])) for at in np.flatnonzero(sizes).tolist()
    ]


def _steps(left: FloatArray) -> FloatArray:
    """Return the mean level after less that before each increment."""
    total = np.concatenate([[0.0], np.cumsum(left)])
    sums = np.concatenate([[0.0], np.cumsum(total)])
    at = np.arange(len(left)) + 1
    low, high = np.maximum(at - _SIDE, 0), np.minimum(at + _SIDE, len(total))
    after, before = (sums[high] - sums[at]) / (high - at), (sums[at] - sums[low]) / (at - low)
    return np.asarray(after - before)


def _scatter(shaft: Shaft, steps: FloatArray, good: NDArray[np.bool_]) -> FloatArray:
    """Return the scatter of the steps at each increment: of those near in time, and as busy."""
    # where the velocity changes as fast as here, steps show its filter and the stamps
    pace = np.nan_to_num(shaft.velocity_rad_s)
    change = maximum_filter1d(pace, 2 * _SIDE + 1) - minimum_filter1d(pace, 2 * _SIDE + 1)
    out = np.full(len(steps), 1e-12)
    at = np.flatnonzero(good)
    for ranked in (at, at[np.argsort(change[at])]):
        least = 0.0
        for part in np.array_split(ranked, max(1, len(at) // AROUND)):
            # no jump touches 0.85 of them, which normal values hold within 1.44 deviations
            size = float(np.quantile(np.abs(steps[part]), 0.85)) / 1.44
            # the busiest are few: nothing is quieter than what is less busy
            least = size if ranked is at else max(least, size)
            out[part] = np.maximum(out[part], least)
    return out


def _peaks(left: FloatArray, floor: FloatArray, good: NDArray[np.bool_]) -> list[tuple[int, float]]:
    """Return place and size of the largest sudden step in each stretch where steps stand out."""
    steps = _steps(left)
    far = np.flatnonzero(good & (np.abs(steps) > floor))
    around = np.convolve(left, np.ones(3), mode="same")
    peaks = []
    for part in np.split(far, np.flatnonzero(np.diff(far) > _SIDE) + 1):
        if not len(part):
            continue
        at = int(part[np.argmax(np.abs(steps[part]) + np.abs(left[part]))])
        # a ramp, such as a filter's, spreads over many intervals
        if around[at] * steps[at] > 0.0 and abs(around[at]) > 0.5 * abs(steps[at]):
            peaks.append((at, float(steps[at])))
    return peaks
