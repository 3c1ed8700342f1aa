"""The converter: clipping, stuck values, and the comb that coarse steps leave in the codes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.acquisition.flags import mask_runs
from hdbench.diagnosis.detect.transform import unit_wave
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = ["Comb", "clipped_samples", "find_comb", "nominal_step_nm", "stuck_samples"]

# the last code of a converter that clips holds this many times the samples of the codes before it
_CLIP_RATIO = 5
_CLIP_LEAST = 5
# a signal that does not change sits on few codes, and its outermost one is no limit
_CLIP_CODES = 8
# this many equal samples in a row do not come from a channel with noise
_STUCK = 20
# where more neighbours than this are equal outside of long runs, the steps are coarse: a run is
# then one level that lasts, unless the channel leaves it by more than one level
_COARSE_RATE = 0.25
# probability of such a run anywhere on the record
_STUCK_CHANCE = 1e-6
# with a comb this coarse against the signal equal samples in a row are nothing special
_COARSE_SPAN = 4.0
# levels that a comb needs to be seen, and samples per level
_LEVELS = 4
_PER_LEVEL = 3.0
# mean resultant of the levels on their comb: levels on a grid rounded to a step ten times finer
# still give 0.98
_ON_COMB = 0.9
# samples below which a bit may keep one value by chance
_BIT_SAMPLES = 1000


@dataclass(frozen=True, slots=True)
class Comb:
    """Values of a channel on a grid.

    Parameters
    ----------
    step_nm : float
        Distance between neighbouring levels, N m.
    std_nm : float
        Its standard uncertainty, N m.
    levels : int
        Levels that occur.
    """

    step_nm: float
    std_nm: float
    levels: int


def nominal_step_nm(profile: ProfileData) -> float:
    """Return the torque of one step of the profile's converter, N m.

    Parameters
    ----------
    profile : ProfileData
        Converter range and resolution, sensor gain.

    Returns
    -------
    float
    """
    volts = 2.0 * profile.daq.range_v / 2**profile.daq.resolution_bits
    return float(volts * profile.sensor.gain_nm_per_v)


def clipped_samples(trace: Trace, profile: ProfileData, torque: FloatArray) -> NDArray[np.bool_]:
    """Return samples at the end of the converter's range, or piled up at an extreme value.

    Parameters
    ----------
    trace : Trace
        Channels; ``torque_v`` is held against the range where it is there.
    profile : ProfileData
        Converter.
    torque : ndarray, shape (n_samples,)
        Torque, N m; NaN where lost.

    Returns
    -------
    ndarray of bool, shape (n_samples,)
        An extreme value is a limit where it holds five times the samples of each of the three
        values before it, away from the median.
    """
    clipped = np.zeros(len(torque), dtype=bool)
    if "torque_v" in trace:
        step = 2.0 * profile.daq.range_v / 2**profile.daq.resolution_bits
        clipped |= np.abs(trace["torque_v"]) >= profile.daq.range_v - 1.5 * step
    present = torque[np.isfinite(torque)]
    if len(present) < _STUCK:
        return clipped
    values, counts = np.unique(present, return_counts=True)
    if len(values) < _CLIP_CODES:
        return clipped
    for end, neighbours in ((0, counts[1:4]), (len(values) - 1, counts[-4:-1])):
        if counts[end] >= max(_CLIP_LEAST, _CLIP_RATIO * int(neighbours.max())):
            clipped |= torque == values[end]
    return clipped


def stuck_samples(torque: FloatArray) -> NDArray[np.bool_]:
    """Return samples in runs of twenty equal values that noise cannot make.

    Parameters
    ----------
    torque : ndarray, shape (n_samples,)
        Torque, N m; NaN where lost.

    Returns
    -------
    ndarray of bool, shape (n_samples,)
        None of runs that the rate of equal neighbours around them makes by itself, as on a channel
        whose steps are coarse against its noise.
    """
    same = np.zeros(len(torque), dtype=bool)
    if len(torque) < _STUCK:
        return same
    moves = np.diff(np.where(np.isfinite(torque), torque, np.nan))
    equal = np.concatenate([[False], moves == 0.0])
    long = [(a, b) for a, b in mask_runs(equal) if b - a + 2 >= _STUCK]
    outside = np.ones(len(moves), dtype=bool)
    for first, last in long:
        outside[first - 1 : last] = False
    known = moves[outside & np.isfinite(moves)]
    jumps = np.abs(known[known != 0.0])
    if not len(jumps):
        return same
    # one more of each kind: no rate is ever known to be zero
    rate = (len(known) - len(jumps) + 1.0) / (len(known) + 2.0)
    step = float(np.median(jumps)) if rate > _COARSE_RATE else 0.0
    for first, last in long:
        ends = [abs(moves[k]) for k in (first - 2, last) if 0 <= k < len(moves)]
        unlikely = (last - first + 1) * np.log(rate) + np.log(len(moves)) < np.log(_STUCK_CHANCE)
        if unlikely and max(ends, default=0.0) > 1.5 * step:
            same[first - 1 : last + 1] = True
    return same


def find_comb(torque: FloatArray) -> Comb | None:
    """Return the grid on which a channel's values lie.

    Parameters
    ----------
    torque : ndarray, shape (n_samples,)
        Torque, N m; NaN where lost.

    Returns
    -------
    Comb or None
        None where the values lie on no grid, or are too few to tell.

    Notes
    -----
    With levels v_j the step q maximises ``|mean exp(2 pi i v_j / q)|`` near the median distance of
    neighbouring levels. A last stage that rounds to a finer grid does not hide it.
    """
    present = torque[np.isfinite(torque)]
    levels = np.unique(present)
    if len(levels) < _LEVELS or len(present) < _PER_LEVEL * len(levels):
        return None
    # the resolution of 8-byte numbers makes one level of two
    span = float(levels[-1] - levels[0])
    levels = levels[np.concatenate([[True], np.diff(levels) > 1e-9 * span])]
    guess = float(np.median(np.diff(levels)))
    centre = levels[np.argsort(np.abs(levels - np.median(present)))]
    step = guess
    # from the nearest levels outwards, so that the phase never slips by a whole step
    for reach in (8, 64, 512, len(levels)):
        part = centre[:reach]
        width = max(float(np.ptp(part)), guess)
        steps = step * (1.0 + np.linspace(-1.0, 1.0, 201) * 0.5 * step / width)
        offsets = (part - part[0])[:, None] / steps
        resultant = np.abs(unit_wave(offsets).mean(axis=0, dtype=np.complex128))
        step = float(steps[int(np.argmax(resultant))])
        if reach >= len(levels):
            break
    if not float(resultant.max()) >= _ON_COMB:
        return None
    spread = float(np.sqrt(-2.0 * np.log(min(1.0, float(resultant.max()))))) / (2.0 * np.pi)
    # a rounded level is off by up to half a unit of the grid below; at least double rounding
    std = max(spread, 1e-12) * step * step * np.sqrt(12.0 / len(levels)) / span
    return Comb(_stuck_bit(present, step), float(std), len(levels))


def _stuck_bit(present: FloatArray, step: float) -> float:
    """Return the weight of the highest bit that never changes, or `step` where all bits do."""
    codes = np.unique(np.round((present - present.min()) / step).astype(np.int64))
    if len(present) < _BIT_SAMPLES:
        return step
    weight = step
    for bit in range(1, 12):
        # half of all blocks of 2^bit codes stay empty, every second one, for some phase
        size = 1 << bit
        if float(codes[-1]) < _COARSE_SPAN * 2 * size:
            break
        residues = np.unique(codes % (2 * size))
        gaps = np.diff(residues, append=residues[0] + 2 * size)
        widest = int(np.argmax(gaps))
        # the codes that occur lie within one half of each pair of blocks: more than a half is free
        if gaps[widest] > size:
            first = residues[(widest + 1) % len(residues)]
            if len(np.unique((codes - first) >> bit)) >= _LEVELS:
                weight = step * size
    return weight
