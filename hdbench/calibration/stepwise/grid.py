"""Steps that the series of a group have in common."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

from hdbench.calibration.readings import TakenReading

__all__ = ["load_grid"]

# share of the smallest distance between two loads within which torques are one step: a reference
# sensor that is read at each load differs from series to series, but not by a third of a step
_SAME_STEP = 0.3
# and never more than this share of the largest, where there is a single load
_SAME_LOAD = 0.05


def load_grid(experiments: Iterable[list[TakenReading]], zero_nm: float) -> list[float]:
    """Return the steps: torques of all series, those of one load made one."""
    torques: list[float] = []
    smallest = math.inf
    for own in experiments:
        for branch in ("up", "down"):
            loads = sorted(
                {
                    abs(t.reading.torque_nm)
                    for t in own
                    if t.reading.series == branch and abs(t.reading.torque_nm) > zero_nm
                }
            )
            torques += loads
            # rounding makes two of one torque: a distance of that size is none
            gaps = [b - a for a, b in itertools.pairwise(loads) if b - a > 1e-6 * b]
            smallest = min([smallest, *gaps])
    reach, torques_end = _SAME_STEP * smallest, max(torques)
    steps: list[list[float]] = []
    for torque in sorted(torques):
        if steps and torque - steps[-1][-1] <= min(reach, _SAME_LOAD * torques_end):
            steps[-1].append(torque)
        else:
            steps.append([torque])
    return [s[0] if s[0] == s[-1] else math.fsum(s) / len(s) for s in steps]
