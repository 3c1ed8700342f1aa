"""Readings of a calibration as arrays: what is used, and the columns of the baseline."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.answer.records import DataFlag
from hdbench.model.motion import Motion
from hdbench.model.statics import experiment_numbers, motion_from_loads, reading_times
from hdbench.profile.schema import ProfileData
from hdbench.records import LoadReading, Loads
from hdbench.records.trace import FloatArray

__all__ = ["LoadTable", "base_columns", "groupings", "inspect_loads", "levels", "load_table"]

# positions closer than this are one: a sixth of a tooth of 200, above what an encoder at the
# output or a mark made by hand repeats
_POSITION_RAD = 5e-3
# torques of one load level differ by less than this share of the largest
_LEVEL_SHARE = 1e-3
# this many equal readings in a row under different loads do not come from a live channel
_STUCK = 3

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class LoadTable:
    """Readings as arrays of shape (n_readings,)."""

    motion: Motion
    reading_v: FloatArray
    mean_std_v: FloatArray  # by its own samples; NaN where not written
    used: NDArray[np.bool_]
    experiment: IntArray
    place: IntArray  # flexspline position
    cell: IntArray  # clamping: position and direction
    names: tuple[str, ...]  # of the experiments
    falling: NDArray[np.bool_]  # unloading
    time_measured: bool  # False: the reading's number

    def __len__(self) -> int:
        return len(self.reading_v)

    @property
    def torque_nm(self) -> FloatArray:
        """Applied torque, N m."""
        load = self.motion.load_torque_nm
        return np.zeros(len(self)) if load is None else load

    @property
    def top_nm(self) -> float:
        """Largest applied torque, N m."""
        return float(np.abs(self.torque_nm).max())

    @property
    def time_unit(self) -> str:
        """Unit of the time."""
        return "s" if self.time_measured else "reading"

    def with_signal(self, signal_nm: FloatArray) -> LoadTable:
        """Return the readings with the torque in the channel, for causes that act on all of it."""
        return replace(self, motion=replace(self.motion, simulated_nm=signal_nm))


def _places(position_rad: FloatArray) -> IntArray:
    """Return the number of each position; a full turn is the same position."""
    known: list[float] = []
    numbers = []
    for position in position_rad.tolist():
        apart = np.abs(np.remainder(position - np.array(known) + np.pi, 2.0 * np.pi) - np.pi)
        near = np.flatnonzero(apart < _POSITION_RAD)
        numbers.append(int(near[0]) if len(near) else len(known))
        if not len(near):
            known.append(position)
    return np.array(numbers, dtype=np.int64)


def load_table(loads: Loads, profile: ProfileData) -> LoadTable:
    """Return readings as arrays; `DataError` as `motion_from_loads`."""
    motion = motion_from_loads(loads, profile)
    readings = loads.readings
    volts = np.array([r.reading_v for r in readings], dtype=np.float64)
    place = _places(motion.output_angle_rad)
    ccw = np.array([r.direction == "ccw" for r in readings])
    _, cell = np.unique(2 * place + ccw, return_inverse=True)
    # preloads and shunt readings of a calibration record are no readings
    kinds = loads.extra_columns.get("kind") or ("",) * len(loads)
    return LoadTable(
        motion=motion,
        reading_v=volts,
        mean_std_v=np.array([_mean_std(r) for r in readings]),
        used=np.isfinite(volts) & np.array([k.strip() in ("", "reading") for k in kinds]),
        experiment=experiment_numbers(loads),
        place=place,
        cell=cell.astype(np.int64),
        names=tuple(dict.fromkeys(r.experiment for r in readings)),
        falling=np.array([r.series == "down" for r in readings]),
        time_measured=reading_times(loads)[1],
    )


def _mean_std(reading: LoadReading) -> float:
    """Return the standard deviation of a mean of independent samples, V; NaN where not known."""
    if reading.reading_std_v is None or not reading.n_samples:
        return float("nan")
    return float(reading.reading_std_v / np.sqrt(reading.n_samples))


def one_hot(numbers: IntArray) -> FloatArray:
    """Return one column per number, 1.0 where it stands."""
    return np.asarray(numbers[:, None] == np.unique(numbers)[None, :], dtype=np.float64)


def levels(table: LoadTable) -> IntArray:
    """Return the number of each reading's load level, in rising torque."""
    torque = table.torque_nm
    order = np.argsort(torque, kind="stable")
    numbers = np.zeros(len(torque), dtype=np.int64)
    far = np.diff(torque[order]) > _LEVEL_SHARE * max(table.top_nm, 1e-300)
    numbers[order] = np.concatenate(([0], np.cumsum(far)))
    return numbers


def groupings(table: LoadTable) -> list[tuple[str, IntArray]]:
    """Return the ways in which gains may differ, the coarsest first."""
    kinds = (("positions", table.place), ("clampings", table.cell))
    found: list[tuple[str, IntArray]] = []
    for name, groups in (*kinds, ("experiments", table.experiment)):
        count = len(np.unique(groups))
        if count > 1 and all(count > len(np.unique(other)) for _, other in found):
            found.append((name, groups))
    return found


def base_columns(table: LoadTable, groups: IntArray | None = None) -> FloatArray:
    """Return the baseline: applied torque, one zero per experiment, and gains of groups."""
    columns = [table.torque_nm[:, None], one_hot(table.experiment)]
    if groups is not None:
        columns.append(table.torque_nm[:, None] * one_hot(groups)[:, 1:])
    return np.hstack(columns)


def inspect_loads(table: LoadTable, profile: ProfileData) -> tuple[LoadTable, tuple[DataFlag, ...]]:
    """Leave out lost and stuck readings and those at the end of the converter's range."""
    volts = table.reading_v
    lost = ~np.isfinite(volts)
    step = 2.0 * profile.daq.range_v / 2**profile.daq.resolution_bits
    ends = np.abs(np.where(lost, 0.0, volts)) >= profile.daq.range_v - 1.5 * step
    stuck = _stuck(table)
    flags = []
    for name, where in (("missed-samples", lost), ("saturation", ends), ("stuck-value", stuck)):
        if where.any():
            time = table.motion.time_s[where]
            flags.append(DataFlag(name, float(time[0]), float(time[-1]), int(where.sum())))
    return replace(table, used=table.used & ~(lost | ends | stuck)), tuple(flags)


def _stuck(table: LoadTable) -> NDArray[np.bool_]:
    """Return the readings that equal their neighbours although the load changed."""
    same = (np.diff(table.reading_v) == 0.0) & (np.diff(table.torque_nm) != 0.0)
    run = np.cumsum(np.concatenate(([True], ~same)))
    return np.asarray(np.bincount(run)[run] >= _STUCK)
