"""Converter of the torque: clipping, stuck values, and coarse steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.faults.fault import Fault, fault_over
from hdbench.diagnosis.faults.scatter import CERTAIN_NATS, STUCK, mask_runs, tail_nats
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace
from hdbench.results.diagnosis import ParameterValue

# chance of any statistical finding in a channel of a log without a fault
CHANCE = 1e-5


@dataclass(frozen=True, slots=True)
class Steps:
    """Values of a channel on a grid: step and its uncertainty, and how many levels occur."""

    step: float
    std: float
    levels: int

    def mean_error(self, predicted: FloatArray, level: float, noise: float) -> FloatArray:
        """Return the mean reading less the true value."""
        # q/pi sum_k (-1)^k / k exp(-2 (pi k s / q)^2) sin(2 pi k (m - m0) / q) of true values m,
        # any level m0 of the grid, and normal noise s ahead of the converter
        turn = 2.0 * np.pi * (predicted - level) / self.step
        out = np.zeros(len(predicted))
        for k in range(1, 30):
            weight = float(np.exp(-2.0 * (np.pi * k * noise / self.step) ** 2))
            out += (-1.0) ** k / k * weight * np.sin(k * turn)
        return np.asarray(self.step / np.pi * out)


def clipping(
    trace: Trace, profile: ProfileData, torque_nm: FloatArray
) -> tuple[NDArray[np.bool_], tuple[Fault, ...]]:
    """Return samples at the end of the converter's range or piled up at an extreme value."""
    clipped = np.zeros(len(torque_nm), dtype=bool)
    if "torque_v" in trace:
        step = 2.0 * profile.daq.range_v / 2**profile.daq.resolution_bits
        clipped |= np.abs(trace["torque_v"]) >= profile.daq.range_v - 1.5 * step
    for level, _ in piled_up(torque_nm):
        clipped |= torque_nm == level
    if not clipped.any():
        return clipped, ()
    values, counts = np.unique(torque_nm[np.isfinite(torque_nm)], return_counts=True)
    limits = np.unique(torque_nm[clipped])
    beside = counts[~np.isin(values, limits)]
    expected = float(max(1, *beside[:3], *beside[-3:]))
    # Poisson numbers as large as at the values next to the limit were to be expected there
    seen = float(clipped.sum())
    nats = min(tail_nats(seen, expected), CERTAIN_NATS)
    parameters = {
        "limit_nm": ParameterValue(float(np.abs(limits).max()), None, "N m"),
        "samples": ParameterValue(seen, 0.0, "1"),
    }
    times = trace.time_s[clipped]
    return clipped, (
        fault_over("saturation", parameters, times, nats, masked=clipped, domain="torque"),
    )


def piled_up(values: FloatArray, chance: float = CHANCE) -> list[tuple[float, int]]:
    """Return the ends at which a channel piles up, and how many samples are there."""
    levels, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    if len(levels) < 8:
        return []
    # a limit holds five times the samples of each of the three values before it, where a sine has
    # 2.4 times as many
    ends = ((0, counts[1:4]), (-1, counts[-4:-1]))
    return [
        (float(levels[end]), int(counts[end]))
        for end, beside in ends
        if counts[end] >= 5 * beside.max()
        and tail_nats(counts[end], beside.max()) > -np.log(0.5 * chance)
    ]


def stuck_samples(torque_nm: FloatArray) -> NDArray[np.bool_]:
    """Return samples in runs of twenty equal values that its noise cannot make."""
    same = np.zeros(len(torque_nm), dtype=bool)
    if len(torque_nm) < STUCK:
        return same
    moves = np.diff(torque_nm)
    long = [(a, b) for a, b in mask_runs(moves == 0.0) if b - a + 2 >= STUCK]
    outside = np.isfinite(moves)
    for first, last in long:
        outside[first : last + 1] = False
    known = moves[outside]
    jumps = np.abs(known[known != 0.0])
    if not len(jumps):
        return same
    # one more of each kind: no rate is ever known to be zero
    rate = (len(known) - len(jumps) + 1.0) / (len(known) + 2.0)
    # where more than a quarter of the neighbours are equal the steps are coarse: a run is then one
    # level that lasts, unless the channel leaves it by more than one level
    step = float(np.median(jumps)) if rate > 0.25 else 0.0
    for first, last in long:
        ends = [abs(moves[k]) for k in (first - 1, last + 1) if 0 <= k < len(moves)]
        unlikely = (last - first + 1) * np.log(rate) + np.log(len(moves)) < np.log(CHANCE)
        if unlikely and max(ends, default=0.0) > 1.5 * step:
            same[first : last + 2] = True
    return same


def coarse_steps(values: FloatArray) -> Steps | None:
    """Return the grid on which a channel's values lie; None for none, or too few values."""
    present = values[np.isfinite(values)]
    levels = np.unique(present)
    # a grid is seen on four levels with three samples each
    if len(levels) < 4 or len(present) < 3 * len(levels):
        return None
    span = float(levels[-1] - levels[0])
    # the resolution of 8-byte numbers makes one level of two
    levels = levels[np.concatenate([[True], np.diff(levels) > 1e-9 * span])]
    if len(levels) < 4:
        return None
    step = float(np.median(np.diff(levels)))
    order = np.argsort(np.abs(levels - np.median(present)))
    # from the nearest levels outwards, so that no level is taken for its neighbour
    for reach in (8, 64, 512, 4096):
        centre = levels[order][:reach] - levels[order][0]
        numbers = np.round(centre / step)
        step = float(numbers @ centre / max(float(numbers @ numbers), 1.0))
        if not step > 0.0:
            return None
    off = centre / step - numbers
    # mean resultant of the levels on their grid: levels rounded to a step ten times finer have 0.98
    if float(np.mean(np.cos(2.0 * np.pi * off))) < 0.9:
        return None
    # a rounded level is off by up to half a unit of the grid below; at least double rounding
    std = step * max(float(np.std(off)), 1e-12) / float(np.linalg.norm(numbers))
    return Steps(step, std, len(levels))


def step_of(values: FloatArray) -> float:
    """Return the step of a channel's values; 0 where they lie on no grid that can be seen."""
    known = values[np.isfinite(values)]
    # levels of a fast channel are too many to be met twice; those of its changes are not
    for _ in range(3):
        steps = coarse_steps(known)
        if steps is not None:
            return float(steps.step)
        known = np.diff(known)
    return 0.0


def quantisation(
    time_s: FloatArray,
    torque_nm: FloatArray,
    scatter_nm: float,
    profile: ProfileData,
    *,
    volts: bool,
) -> Fault | None:
    """Return steps of the torque above its noise and its converter's as a fault."""
    steps = coarse_steps(torque_nm)
    converter = 2.0 * profile.daq.range_v / 2**profile.daq.resolution_bits
    finer = converter * profile.sensor.gain_nm_per_v if volts else 0.0
    if steps is None or not steps.step > max(scatter_nm, 1.5 * finer):
        return None
    finer = finer or scatter_nm
    times = time_s[np.isfinite(torque_nm)]
    # each sample on one of the levels instead of any value in between
    nats = len(times) * float(np.log(max(steps.step / finer, 1.0 + 1e-9)))
    parameters = {
        "step_nm": ParameterValue(steps.step, steps.std, "N m"),
        "levels": ParameterValue(steps.levels, 0.0, "1"),
    }
    shape = {"step_nm": steps.step}
    return fault_over("quantisation", parameters, times, nats, shape=shape, domain="torque")
