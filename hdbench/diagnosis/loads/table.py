"""Readings of a calibration as arrays: what is used, and the columns of the baseline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.faults.fault import flag_samples
from hdbench.model.motion import Motion
from hdbench.model.statics import experiment_numbers, motion_from_loads, reading_times
from hdbench.profile.schema import ProfileData
from hdbench.records import Loads
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import LeftOutSamples, StretchFlag

# flags of readings that take no part, and the reason that is told
_REASONS = {
    "missed-samples": "the reading is lost",
    "saturation": "at the end of the converter's range",
    "stuck-value": "equal readings under different loads",
}

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class LoadTable:
    """Readings as arrays of shape (n_readings,)."""

    motion: Motion
    torque_nm: FloatArray  # applied
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
    def top_nm(self) -> float:
        """Largest applied torque, N m."""
        return float(np.abs(self.torque_nm).max())

    def with_signal(self, signal_nm: FloatArray) -> LoadTable:
        """Return the readings with the torque in the channel, for causes that act on all of it."""
        return replace(self, motion=replace(self.motion, simulated_nm=signal_nm))


def load_table(loads: Loads, profile: ProfileData) -> tuple[LoadTable, tuple[StretchFlag, ...]]:
    """Return readings as arrays, and what is wrong with those that are not used."""
    motion = motion_from_loads(loads, profile)
    readings = loads.readings
    volts = np.array([r.reading_v for r in readings], dtype=np.float64)
    torque = np.array([r.torque_nm for r in readings], dtype=np.float64)
    std = np.array([r.reading_std_v or np.nan for r in readings], dtype=np.float64)
    samples = np.array([r.n_samples or np.nan for r in readings], dtype=np.float64)
    place = _places(motion.output_angle_rad)
    # preloads and shunt readings of a calibration record are no readings
    kinds = loads.extra_columns.get("kind") or ("",) * len(loads)
    used = np.array([kind.strip() in ("", "reading") for kind in kinds])
    lost = ~np.isfinite(volts)
    step = 2.0 * profile.daq.range_v / 2**profile.daq.resolution_bits
    ends = np.abs(np.where(lost, 0.0, volts)) >= profile.daq.range_v - 1.5 * step
    # equal to their neighbours although the load changed
    same = (np.diff(volts) == 0.0) & (np.diff(torque) != 0.0)
    run = np.cumsum(np.concatenate(([True], ~same)))
    # this many equal readings in a row under different loads do not come from a live channel
    stuck = np.bincount(run)[run] >= 3
    flags: tuple[StretchFlag, ...] = ()
    for name, where in zip(_REASONS, (lost, ends, stuck), strict=True):
        used &= ~where
        flags += flag_samples(name, motion.time_s, where)
    table = LoadTable(
        motion=motion,
        torque_nm=torque,
        reading_v=volts,
        mean_std_v=std / np.sqrt(samples),
        used=used,
        experiment=experiment_numbers(loads),
        place=place,
        cell=2 * place + np.array([r.direction == "ccw" for r in readings]),
        names=tuple(dict.fromkeys(r.experiment for r in readings)),
        falling=np.array([r.series == "down" for r in readings]),
        time_measured=reading_times(loads)[1],
    )
    return table, flags


def _places(position_rad: FloatArray) -> IntArray:
    """Return the number of each position; a full turn is the same position."""
    known: list[float] = []
    numbers = []
    for position in position_rad.tolist():
        apart = np.abs(np.remainder(position - np.array(known) + np.pi, 2.0 * np.pi) - np.pi)
        # positions closer than this are one: a sixth of a tooth of 200, above what an encoder at
        # the output or a mark made by hand repeats
        near = np.flatnonzero(apart < 5e-3)
        numbers.append(int(near[0]) if len(near) else len(known))
        if not len(near):
            known.append(position)
    return np.array(numbers, dtype=np.int64)


def one_hot(numbers: IntArray) -> FloatArray:
    """Return one column per number, 1.0 where it stands."""
    return np.asarray(numbers[:, None] == np.unique(numbers)[None, :], dtype=np.float64)


def levels(table: LoadTable) -> IntArray:
    """Return the number of each reading's load level, in rising torque."""
    torque = table.torque_nm
    order = np.argsort(torque, kind="stable")
    numbers = np.zeros(len(torque), dtype=np.int64)
    # torques of one load level differ by less than this share of the largest
    far = np.diff(torque[order]) > 1e-3 * table.top_nm
    numbers[order] = np.concatenate(([0], np.cumsum(far)))
    return numbers


def groupings(table: LoadTable) -> list[tuple[str, IntArray]]:
    """Return the ways in which gains may differ, the coarsest first."""
    kinds = (
        ("positions", table.place),
        ("clampings", table.cell),
        ("experiments", table.experiment),
    )
    found: list[tuple[str, IntArray]] = []
    most = 1
    for name, groups in kinds:
        count = len(np.unique(groups))
        if count > most:
            found.append((name, groups))
            most = count
    return found


def base_columns(table: LoadTable, groups: IntArray | None = None) -> FloatArray:
    """Return the baseline: applied torque, one zero per experiment, and gains of groups."""
    columns = [table.torque_nm[:, None], one_hot(table.experiment)]
    if groups is not None:
        columns.append(table.torque_nm[:, None] * one_hot(groups)[:, 1:])
    return np.hstack(columns)


def left_out(table: LoadTable, flags: Sequence[StretchFlag]) -> tuple[LeftOutSamples, ...]:
    """Return which readings took no part, and why."""
    counts = {_REASONS[flag.name]: flag.samples for flag in flags}
    others = int((~table.used).sum()) - sum(counts.values())
    if others > 0:
        counts["a preload or shunt reading"] = others
    return tuple(LeftOutSamples(why, n, n / len(table)) for why, n in counts.items())
