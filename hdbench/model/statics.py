"""Static readings as a standing motion, so that causes predict them like any record."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import DataError
from hdbench.model.motion import Motion, gauge_order_factor
from hdbench.profile.schema import ProfileData
from hdbench.records import Loads
from hdbench.records.trace import FloatArray


def experiment_numbers(loads: Loads) -> NDArray[np.int64]:
    """Return the number of each reading's experiment."""
    names: dict[str, int] = {}
    numbers = [names.setdefault(r.experiment, len(names)) for r in loads.readings]
    return np.array(numbers, dtype=np.int64)


def reading_times(loads: Loads) -> tuple[FloatArray, bool]:
    """Return when each reading was taken."""
    number = np.arange(len(loads), dtype=np.float64)
    given = [reading.time_s for reading in loads.readings]
    if len(given) < 2 or any(t is None for t in given):
        return number, False
    time = np.array(given, dtype=np.float64)
    experiment = experiment_numbers(loads)
    steps = np.diff(time)
    inside = experiment[1:] == experiment[:-1]
    if not (np.isfinite(time).all() and bool(np.all(steps[inside] > 0.0))):
        return number, False
    usual = float(np.median(steps[inside])) if inside.any() else 1.0
    back = ~inside & (steps <= 0.0)
    time[1:] += np.cumsum(np.where(back, usual - steps, 0.0))
    return time, True


def motion_from_loads(loads: Loads, profile: ProfileData) -> Motion:
    """Return static readings as a motion that stands still.

    Notes
    -----
    ``simulated_nm`` is the applied torque: what the sensor would show with a zero of 0.
    """
    if not len(loads):
        raise DataError(
            "found 0 readings; needed: at least one",
            where=loads.source,
            fix="give a loads file with readings",
        )
    torque = np.array([r.torque_nm for r in loads.readings], dtype=np.float64)
    position = np.array([r.position_rad for r in loads.readings], dtype=np.float64)
    bad = np.flatnonzero(~(np.isfinite(torque) & np.isfinite(position)))
    if len(bad):
        raise DataError(
            f"reading {int(bad[0]) + 1} has torque {torque[bad[0]]:g} N m at position "
            f"{position[bad[0]]:g} rad; needed: finite numbers",
            where=loads.source,
            fix="correct or remove that reading",
        )
    time, _ = reading_times(loads)
    experiment = experiment_numbers(loads)
    starts = np.concatenate(([True], experiment[1:] != experiment[:-1]))
    still = np.zeros(len(torque))
    given = [r.temperature_c for r in loads.readings]
    warm = None if any(t is None for t in given) else np.array(given, dtype=np.float64)
    ratio = profile.drive.gear_ratio
    return Motion(
        time_s=time,
        velocity_rad_s=still,
        angle_rad=ratio * position,
        acceleration_rad_s2=still,
        output_angle_rad=position,
        valid=np.ones(len(torque), dtype=bool),
        angle_source="position_rad",
        gear_ratio=ratio,
        output_source="position_rad",
        gauge_factor=gauge_order_factor(profile.drive),
        load_torque_nm=torque,
        temperature_c=warm,
        inertia_nm_s2=profile.drive.load_inertia_kg_m2 / ratio,
        starts=starts,
        simulated_nm=torque,
    )


# what a reading of a preload has in common with the reading that it repeats
_REPEATED = ("velocity_rad_s", "angle_rad", "acceleration_rad_s2", "output_angle_rad", "valid")


def preloaded_motion(motion: Motion) -> tuple[Motion, NDArray[np.int64]]:
    """Return a standing motion in which every experiment follows one preload.

    Notes
    -----
    Whatever remembers the torque and not the time begins the experiment as it would begin its
    second cycle: calibration guides ask for preloads to the largest torque before each series.
    """
    load, starts = motion.load_torque_nm, motion.starts
    torque = np.zeros(len(motion)) if load is None else load
    begun = np.flatnonzero(starts).tolist() if starts is not None else [0]
    source: list[int] = []
    readings: list[int] = []
    for first, last in pairwise([*begun, len(motion)]):
        far = first + int(np.argmax(np.abs(torque[first:last] - torque[first])))
        source += [first, far, first]
        readings += range(len(source), len(source) + last - first)
        source += range(first, last)
    at = np.array(source, dtype=np.int64)
    where = np.array(readings, dtype=np.int64)
    fresh = np.ones(len(at), dtype=bool)
    fresh[where] = False
    fresh[1:] &= ~fresh[:-1]
    warm = motion.temperature_c
    longer = replace(
        motion,
        **{name: getattr(motion, name)[at] for name in _REPEATED},
        time_s=np.arange(len(at), dtype=np.float64),
        load_torque_nm=torque[at],
        temperature_c=None if warm is None else warm[at],
        starts=fresh,
        simulated_nm=None,
    )
    return longer, where
