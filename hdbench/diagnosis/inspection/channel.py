"""One channel by itself: its steps, held samples, limits and stuck values."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.faults.converter import coarse_steps
from hdbench.diagnosis.faults.scatter import mask_runs
from hdbench.records.trace import FloatArray

__all__ = ["held_share", "piled_up", "step_of", "tail_nats"]

# equal neighbours longer than this are a channel at rest, not samples held
_LONGEST = 20
# changes below this part of the largest are rounding of 8-byte numbers
_EQUAL = 1e-9
# a channel moves where its usual change is this many steps: one in thirty is then equal by chance
_MOVES = 8.0
# what is held leaves and comes back by this many steps at least
_LEAVES = 4.0
# samples over which the usual change is taken
_AROUND = 400
# 1 / (sqrt(2 pi) 1.4826): density of normal changes at zero over their median size
_DENSITY = 0.269
# values next to the outermost one that say how often it was to be expected, and how many times
# more it has to be there: a sine piles up 2.4 times
_BESIDE, _PILED = 3, 5
# a channel that does not change sits on few values, and its outermost one is no limit
_FEWEST = 8


def step_of(values: FloatArray) -> float:
    """Return the step of a channel's values; 0 where they lie on no grid that can be seen.

    The levels of a fast channel are too many to be met twice; those of its changes are not.
    """
    known = values[np.isfinite(values)]
    for _ in range(3):
        steps = coarse_steps(known)
        if steps is not None:
            return float(steps.step)
        known = np.diff(known)
    return 0.0


def tail_nats(seen: float, expected: float) -> float:
    """Return the log of one over a bound of the chance to see so many where Poisson says fewer."""
    if seen <= expected or not seen:
        return 0.0
    return float(seen * np.log(seen / max(expected, 1e-12)) - seen + expected)


def held_share(values: FloatArray, step: float, alpha: float, *, smooth: bool = False) -> float:
    """Return the share of samples that repeat the one before although the channel moves.

    Notes
    -----
    A normal change of median size m is 0 on a grid q with probability 0.27 q / m. Counted are
    equal neighbours in stretches with m above 8 q, in short runs that begin and end with a change
    of 4 q, against that number by the Poisson law.
    """
    moves = np.diff(values)
    same = moves == 0.0
    if len(moves) < _AROUND or not same.any() or same.all():
        return 0.0
    sizes = np.abs(moves)
    # rounding twice hides a grid: the smallest change that is there is no less than it
    least = float(np.nanmin(sizes[sizes > _EQUAL * float(np.nanmax(sizes))]))
    step = max(step, least)
    usual = np.zeros(len(moves))
    for part in np.array_split(np.arange(len(moves)), max(1, len(moves) // _AROUND)):
        changed = sizes[part][sizes[part] > 0.0]
        # a few changes in a stretch are steps, not motion
        usual[part] = float(np.median(changed)) if len(changed) > len(part) // 10 else 0.0
    busy = usual > _MOVES * step
    seen = 0
    for first, last in mask_runs(same & busy):
        if first < 2 or last > len(moves) - 3 or last - first >= _LONGEST:
            continue
        before, after = float(sizes[first - 1]), float(sizes[last + 1])
        made_up = (last - first + 1.5) * min(before, float(sizes[last + 2]))
        if min(before, after) > _LEAVES * step and (not smooth or after > made_up):
            seen += last - first + 1
    expected = float(np.sum(_DENSITY * step / usual[busy])) if busy.any() else 0.0
    if tail_nats(seen, expected + 1.0) < -np.log(alpha):
        return 0.0
    return seen / len(values)


def piled_up(values: FloatArray, alpha: float) -> tuple[float, int] | None:
    """Return the value at which a channel piles up and the number of samples there, or None."""
    levels, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    if len(levels) < _FEWEST:
        return None
    found = []
    for end, beside in ((0, counts[1 : 1 + _BESIDE]), (-1, counts[-1 - _BESIDE : -1])):
        most, seen = int(beside.max()), int(counts[end])
        if seen >= _PILED * most and tail_nats(seen, most) > -np.log(0.5 * alpha):
            found.append((float(levels[end]), seen))
    return max(found, key=lambda one: one[1]) if found else None
