"""Converter of the torque: clipping, stuck values, and coarse steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.faults.fault import Fault, entry, mask_runs
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = ["Steps", "clipping", "coarse_steps", "quantisation", "stuck_samples"]

# a limit holds this many times the samples of each of the three values before it, and so many
_CLIP_RATIO = 5
_CLIP_LEAST = 5
# a signal that does not change sits on few values, and its outermost one is no limit
_CLIP_VALUES = 8
# this many equal samples in a row do not come from a channel with noise
_STUCK = 20
# where more neighbours than this are equal outside of long runs, the steps are coarse: a run is
# then one level that lasts, unless the channel leaves it by more than one level
_COARSE_RATE = 0.25
# probability of such a run anywhere on the record
_STUCK_CHANCE = 1e-6
# levels that a grid needs to be seen, samples per level, and levels that are looked at
_LEVELS = 4
_PER_LEVEL = 3.0
_MOST_LEVELS = 4096
# mean resultant of the levels on their grid: levels rounded to a step ten times finer still give
# 0.98
_ON_GRID = 0.9
# samples below which a bit may keep one value by chance
_BIT_SAMPLES = 1000
# with a grid this coarse against the signal no bit can be judged
_COARSE_SPAN = 4.0
# steps of converters with whole bits, and decimals, are met within this part; converters for a
# bench have 12 bits at least
_WHOLE = 0.01
_FEWEST_BITS = 12


@dataclass(frozen=True, slots=True)
class Steps:
    """Values of a channel on a grid.

    Parameters
    ----------
    step, std : float
        Step and its uncertainty, unit of the channel.
    levels : int
        Levels that occur.
    """

    step: float
    std: float
    levels: int

    @property
    def noise(self) -> float:
        """Standard deviation that rounding adds where the noise does not smooth it."""
        return self.step / float(np.sqrt(12.0))

    def mean_error(self, predicted: FloatArray, level: float, noise: float) -> FloatArray:
        """Return the mean reading less the true value.

        Parameters
        ----------
        predicted : ndarray, shape (n,)
            True values m.
        level : float
            Any level m0 of the grid.
        noise : float
            Standard deviation s of the normal noise ahead of the converter.

        Returns
        -------
        ndarray, shape (n,)
            ``q/pi sum_k (-1)^k / k exp(-2 (pi k s / q)^2) sin(2 pi k (m - m0) / q)``.
        """
        turn = 2.0 * np.pi * (predicted - level) / self.step
        out = np.zeros(len(predicted))
        for k in range(1, 30):
            weight = float(np.exp(-2.0 * (np.pi * k * noise / self.step) ** 2))
            if weight < 1e-6:
                break
            out += (-1.0) ** k / k * weight * np.sin(k * turn)
        return np.asarray(self.step / np.pi * out)


def clipping(
    trace: Trace, profile: ProfileData, torque_nm: FloatArray
) -> tuple[NDArray[np.bool_], Fault | None]:
    """Return samples at the end of the converter's range or piled up at an extreme value.

    The evidence is that of so many samples at the limit where Poisson numbers as large as those of
    the values next to it were to be expected.
    """
    clipped = np.zeros(len(torque_nm), dtype=bool)
    if "torque_v" in trace:
        step = 2.0 * profile.daq.range_v / 2**profile.daq.resolution_bits
        clipped |= np.abs(trace["torque_v"]) >= profile.daq.range_v - 1.5 * step
    present = torque_nm[np.isfinite(torque_nm)]
    values, counts = np.unique(present, return_counts=True)
    if len(present) >= _STUCK and len(values) >= _CLIP_VALUES:
        for end, beside in ((0, counts[1:4]), (len(values) - 1, counts[-4:-1])):
            if counts[end] >= max(_CLIP_LEAST, _CLIP_RATIO * int(beside.max())):
                clipped |= torque_nm == values[end]
    if not clipped.any():
        return clipped, None
    limits = np.unique(torque_nm[clipped])
    beside = counts[~np.isin(values, limits)]
    expected = float(max(1, beside[:3].max(initial=1), beside[-3:].max(initial=1)))
    seen = float(clipped.sum())
    nats = max(0.0, seen * float(np.log(seen / expected)) - seen + expected)
    at, time = np.flatnonzero(clipped), trace.time_s
    parameters = {
        "limit_nm": entry(float(np.abs(limits).max()), None, "N m"),
        "samples": entry(seen, 0.0, "1"),
    }
    return clipped, Fault(
        "saturation", parameters, len(at), float(time[at[0]]), float(time[at[-1]]), nats,
        float(np.exp(-min(nats, 700.0))), ("torque_nm",), masked=clipped, domain="torque",
    )  # fmt: skip


def stuck_samples(torque_nm: FloatArray) -> NDArray[np.bool_]:
    """Return samples in runs of twenty equal values that noise cannot make.

    None of runs that the rate of equal neighbours around them makes by itself, as on a channel
    whose steps are coarse against its noise.
    """
    same = np.zeros(len(torque_nm), dtype=bool)
    if len(torque_nm) < _STUCK:
        return same
    moves = np.diff(torque_nm)
    long = [(a, b) for a, b in mask_runs(moves == 0.0) if b - a + 2 >= _STUCK]
    outside = np.isfinite(moves)
    for first, last in long:
        outside[first : last + 1] = False
    known = moves[outside]
    jumps = np.abs(known[known != 0.0])
    if not len(jumps):
        return same
    # one more of each kind: no rate is ever known to be zero
    rate = (len(known) - len(jumps) + 1.0) / (len(known) + 2.0)
    step = float(np.median(jumps)) if rate > _COARSE_RATE else 0.0
    for first, last in long:
        ends = [abs(moves[k]) for k in (first - 1, last + 1) if 0 <= k < len(moves)]
        unlikely = (last - first + 1) * np.log(rate) + np.log(len(moves)) < np.log(_STUCK_CHANCE)
        if unlikely and max(ends, default=0.0) > 1.5 * step:
            same[first : last + 2] = True
    return same


def coarse_steps(values: FloatArray) -> Steps | None:
    """Return the grid on which a channel's values lie.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Torque in N m, or volts; NaN where lost.

    Returns
    -------
    Steps or None
        In the unit of `values`; None where they lie on no grid, or are too few to tell.

    Notes
    -----
    With levels v_j the step q maximises ``|mean exp(2 pi i v_j / q)|`` near the median distance of
    neighbouring levels. A last stage that rounds to a finer grid does not hide it.
    """
    present = values[np.isfinite(values)]
    levels = np.unique(present)
    if len(levels) < _LEVELS or len(present) < _PER_LEVEL * len(levels):
        return None
    span = float(levels[-1] - levels[0])
    # the resolution of 8-byte numbers makes one level of two
    levels = levels[np.concatenate([[True], np.diff(levels) > 1e-9 * span])]
    step = guess = float(np.median(np.diff(levels)))
    order = np.argsort(np.abs(levels - np.median(present)))
    centre = levels[order][:_MOST_LEVELS]
    resultant = 0.0
    # from the nearest levels outwards, so that the phase never slips by a whole step
    for reach in (8, 64, 512, _MOST_LEVELS):
        part = centre[:reach]
        width = max(float(np.ptp(part)), guess)
        steps = step * (1.0 + np.linspace(-1.0, 1.0, 101) * 0.5 * step / width)
        turns = np.exp(2j * np.pi * (part - part[0])[:, None] / steps)
        sizes = np.abs(turns.mean(axis=0))
        step, resultant = float(steps[int(np.argmax(sizes))]), float(sizes.max())
        if reach >= len(centre):
            break
    if not resultant >= _ON_GRID:
        return None
    spread = float(np.sqrt(-2.0 * np.log(min(1.0, resultant)))) / (2.0 * np.pi)
    # a rounded level is off by up to half a unit of the grid below; at least double rounding
    width = float(np.ptp(centre))
    std = max(spread, 1e-12) * step * step * float(np.sqrt(12.0 / len(centre))) / width
    return Steps(_stuck_bit(present, step), std, len(levels))


def _stuck_bit(present: FloatArray, step: float) -> float:
    """Return the weight of the highest bit that never changes, or `step` where all bits do."""
    if len(present) < _BIT_SAMPLES:
        return step
    codes = np.unique(np.round((present - present.min()) / step).astype(np.int64))
    weight = step
    for bit in range(1, 12):
        # half of all blocks of 2^bit codes stay empty, every second one, for some phase
        size = 1 << bit
        if float(codes[-1]) < _COARSE_SPAN * 2 * size:
            break
        residues = np.unique(codes % (2 * size))
        gaps = np.diff(residues, append=residues[0] + 2 * size)
        widest = int(np.argmax(gaps))
        if gaps[widest] > size:
            first = residues[(widest + 1) % len(residues)]
            if len(np.unique((codes - first) >> bit)) >= _LEVELS:
                weight = step * size
    return weight


def _too_coarse(steps: Steps, profile: ProfileData, scatter_nm: float, *, volts: bool) -> bool:
    """Return whether the steps are above the noise, or are none that the profile's converter makes.

    What a channel in N m was computed from is not known: only its noise tells.
    """
    nominal_v = 2.0 * profile.daq.range_v / 2**profile.daq.resolution_bits
    gain = profile.sensor.gain_nm_per_v
    if volts and not steps.step > 1.5 * nominal_v * gain:
        return False
    if steps.step > scatter_nm:
        return True
    if not volts:
        return False
    bits = float(np.log2(2.0 * profile.daq.range_v * gain / steps.step))
    decimals = np.log10(steps.step / gain / np.array([1.0, 2.0, 5.0]))
    off = [abs(10.0 ** (d - round(d)) - 1.0) for d in decimals.tolist()]
    if round(bits) >= _FEWEST_BITS:
        off.append(abs(2.0 ** (bits - round(bits)) - 1.0))
    return bool(min(off) > _WHOLE)


def quantisation(
    time_s: FloatArray,
    torque_nm: FloatArray,
    scatter_nm: float,
    profile: ProfileData,
    *,
    volts: bool,
) -> Fault | None:
    """Return coarse steps of the torque as a fault, None where they are none.

    `volts`: whether the torque is the converter's own reading times the gain.
    """
    steps = coarse_steps(torque_nm)
    if steps is None or not _too_coarse(steps, profile, scatter_nm, volts=volts):
        return None
    nominal = 2.0 * profile.daq.range_v / 2**profile.daq.resolution_bits
    finer = nominal * profile.sensor.gain_nm_per_v if volts else scatter_nm
    count = int(np.isfinite(torque_nm).sum())
    # each sample on one of the levels instead of any value in between
    nats = count * float(np.log(max(steps.step / finer, 1.0 + 1e-9)))
    parameters = {
        "step_nm": entry(steps.step, steps.std, "N m"),
        "levels": entry(steps.levels, 0.0, "1"),
    }
    return Fault(
        "quantisation", parameters, count, float(time_s[0]), float(time_s[-1]), nats,
        float(np.exp(-min(nats, 700.0))), ("torque_nm",), {"step_nm": steps.step}, domain="torque",
    )  # fmt: skip
