"""The stretch of a run in which the motor turns steadily."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.report.signals import Signals

__all__ = ["Steady", "steady_stretch"]


@dataclass(frozen=True, slots=True)
class Steady:
    """A stretch of nearly constant velocity.

    Parameters
    ----------
    from_s, to_s : float
        Begin and end, s.
    velocity_rad_s : float
        Mean motor velocity, rad/s.
    """

    from_s: float
    to_s: float
    velocity_rad_s: float


def steady_stretch(signals: Signals, tolerance: float) -> Steady | None:
    """Return the longest stretch whose velocity keeps within `tolerance` of its median.

    Notes
    -----
    Levels are the velocities held longest (a histogram whose bins are as wide as the tolerance at
    the highest speed); within each level, the longest run of samples in a row.
    """
    velocity = signals.velocity_rad_s
    present = np.isfinite(velocity) & np.isfinite(signals.torque_nm)
    if not present.any():
        return None
    top = float(np.max(np.abs(velocity[present])))
    if not top > 0.0:
        return None
    moving = present & (np.abs(velocity) > 0.1 * top)
    width = tolerance * top
    counts = np.bincount(np.round((velocity[moving] + top) / width).astype(np.intp))
    level = float(np.argmax(counts)) * width - top
    near = present & (np.abs(velocity - level) <= 2.0 * width)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], near.astype(np.int8), [0]))))
    starts, stops = edges[::2], edges[1::2]
    best = int(np.argmax(stops - starts))
    start, stop = int(starts[best]), int(stops[best])
    if stop - start < 64:
        return None
    time = signals.time_s
    return Steady(float(time[start]), float(time[stop - 1]), float(np.mean(velocity[start:stop])))
