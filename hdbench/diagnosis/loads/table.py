"""Readings of a calibration as arrays, and the columns of their baseline."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.model.motion import Motion
from hdbench.model.statics import experiment_numbers, motion_from_loads, reading_times
from hdbench.profile.schema import ProfileData
from hdbench.records import LoadReading, Loads
from hdbench.records.trace import FloatArray

__all__ = ["LoadTable", "base_columns", "load_table"]

# positions closer than this are one position: a sixth of a tooth of 200, above what an encoder at
# the output or a mark made by hand repeats
_POSITION_RAD = 5e-3

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class LoadTable:
    """Readings as arrays of shape (n_readings,).

    Parameters
    ----------
    motion : Motion
        The readings as a standing motion.
    reading_v : ndarray
        Readings, V.
    used : ndarray of bool
        Readings that the fits use.
    experiment : ndarray of int
        Number of the experiment.
    names : tuple of str
        Name of each experiment.
    place : ndarray of int
        Number of the flexspline position.
    cell : ndarray of int
        Number of the combination of position and direction: one clamping of arm and flexspline.
    falling : ndarray of bool
        True while unloading.
    mass_kg : ndarray
        Mass on the arm, kg; NaN where the torque was given.
    time_measured : bool
        False where the time is the reading's number.
    mean_std_v : ndarray
        Standard deviation of each reading by its own samples, V; NaN where that was not written.
    """

    motion: Motion
    reading_v: FloatArray
    used: NDArray[np.bool_]
    experiment: IntArray
    names: tuple[str, ...]
    place: IntArray
    cell: IntArray
    falling: NDArray[np.bool_]
    mass_kg: FloatArray
    time_measured: bool
    mean_std_v: FloatArray

    def __len__(self) -> int:
        return len(self.reading_v)

    @property
    def torque_nm(self) -> FloatArray:
        """Applied torque, N m."""
        load = self.motion.load_torque_nm
        return np.zeros(len(self)) if load is None else load


def _places(position_rad: FloatArray) -> IntArray:
    """Return the number of each position; a full turn is the same position."""
    known: list[float] = []
    numbers = []
    for position in position_rad.tolist():
        for number, other in enumerate(known):
            apart = float(np.remainder(position - other + np.pi, 2.0 * np.pi) - np.pi)
            if abs(apart) < _POSITION_RAD:
                numbers.append(number)
                break
        else:
            numbers.append(len(known))
            known.append(position)
    return np.array(numbers, dtype=np.int64)


def load_table(loads: Loads, profile: ProfileData) -> LoadTable:
    """Return readings as arrays.

    Parameters
    ----------
    loads : Loads
        At least one static reading.
    profile : ProfileData
        Bench.

    Returns
    -------
    LoadTable

    Raises
    ------
    DataError
        As `motion_from_loads`.
    """
    motion = motion_from_loads(loads, profile)
    readings = loads.readings
    volts = np.array([r.reading_v for r in readings], dtype=np.float64)
    place = _places(motion.output_angle_rad)
    ccw = np.array([r.direction == "ccw" for r in readings])
    _, cell = np.unique(2 * place + ccw, return_inverse=True)
    masses = [np.nan if r.mass_kg is None else r.mass_kg for r in readings]
    return LoadTable(
        motion=motion,
        reading_v=volts,
        used=np.isfinite(volts) & _evaluated(loads),
        experiment=experiment_numbers(loads),
        names=tuple(dict.fromkeys(r.experiment for r in readings)),
        place=place,
        cell=cell.astype(np.int64),
        falling=np.array([r.series == "down" for r in readings]),
        mass_kg=np.array(masses, dtype=np.float64),
        time_measured=reading_times(loads)[1],
        mean_std_v=np.array([_mean_std(r) for r in readings], dtype=np.float64),
    )


def _evaluated(loads: Loads) -> NDArray[np.bool_]:
    """Return which rows are readings: preloads and shunt readings are none."""
    kinds = loads.extra_columns.get("kind")
    if kinds is None:
        return np.ones(len(loads), dtype=bool)
    return np.array([kind.strip() in ("", "reading") for kind in kinds], dtype=bool)


def _mean_std(reading: LoadReading) -> float:
    """Return the standard deviation of a mean of independent samples, V; NaN where not known."""
    if reading.reading_std_v is None or not reading.n_samples:
        return float("nan")
    return float(reading.reading_std_v) / math.sqrt(reading.n_samples)


def one_hot(numbers: IntArray) -> FloatArray:
    """Return one column per number, 1.0 where it stands, shape (n_readings, n_numbers)."""
    return np.asarray(numbers[:, None] == np.unique(numbers)[None, :], dtype=np.float64)


def base_columns(table: LoadTable, free_gain: IntArray | None = None) -> FloatArray:
    """Return the columns of the baseline.

    Parameters
    ----------
    table : LoadTable
        Readings.
    free_gain : ndarray of int, shape (n_readings,), or None
        Groups of readings that have a gain of their own; one common gain where None.

    Returns
    -------
    ndarray, shape (n_readings, 1 + n_experiments) or more
        Applied torque, one zero per experiment, and the torque of all groups but the first.
    """
    columns = [table.torque_nm[:, None], one_hot(table.experiment)]
    if free_gain is not None:
        columns.append(table.torque_nm[:, None] * one_hot(free_gain)[:, 1:])
    return np.hstack(columns)
