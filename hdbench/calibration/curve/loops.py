"""The loop of every experiment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdbench.calibration.curve.hysteresis import Loop, loading_loop
from hdbench.calibration.lines import ExperimentLine
from hdbench.calibration.readings import TakenReading

__all__ = ["loading_loops"]

# torques below this share of an experiment's largest are its zero, as for the steps
_ZERO_SHARE = 0.005


def loading_loops(
    readings: Sequence[TakenReading], lines: tuple[ExperimentLine, ...]
) -> dict[str, Loop]:
    """Return the loop of each experiment that was loaded and unloaded."""
    own: dict[str, list[TakenReading]] = {line.id: [] for line in lines}
    for taken in readings:
        own[taken.reading.experiment].append(taken)
    found: dict[str, Loop] = {}
    for line in lines:
        branches = [
            (
                np.array([abs(t.reading.torque_nm) for t in own[line.id] if t.reading.series == s]),
                np.array([t.reading.reading_v for t in own[line.id] if t.reading.series == s]),
            )
            for s in ("up", "down")
        ]
        top = max(abs(t.reading.torque_nm) for t in own[line.id])
        # anticlockwise torques are counted as positive too: so is then the gain
        sign = 1.0 if line.direction == "cw" else -1.0
        loop = loading_loop(
            branches[0], branches[1], sign * line.gain_nm_per_v.value, _ZERO_SHARE * top
        )
        if loop is not None:
            found[line.id] = loop
    return found
