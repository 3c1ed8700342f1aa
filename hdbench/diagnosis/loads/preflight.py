"""Readings that cannot be right, found before anything is fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.loads.table import LoadTable
from hdbench.diagnosis.measured.preflight import DataFlag
from hdbench.profile.schema import ProfileData

__all__ = ["inspect_loads"]

# this many equal readings in a row under different loads do not come from a live channel
_STUCK = 3


def inspect_loads(table: LoadTable, profile: ProfileData) -> tuple[LoadTable, tuple[DataFlag, ...]]:
    """Mark readings at the end of the converter's range, stuck ones and lost ones.

    Parameters
    ----------
    table : LoadTable
        Readings.
    profile : ProfileData
        Range and resolution of the converter.

    Returns
    -------
    table : LoadTable
        Lost, stuck and saturated readings are not used.
    flags : tuple of DataFlag
        What was marked; times are reading numbers from 0 where no time was written.
    """
    volts = table.reading_v
    lost = ~np.isfinite(volts)
    step = 2.0 * profile.daq.range_v / 2**profile.daq.resolution_bits
    ends = ~lost & (np.abs(np.where(lost, 0.0, volts)) >= profile.daq.range_v - 1.5 * step)
    stuck = _stuck(table)
    flags = []
    for name, where in (("missed-samples", lost), ("saturation", ends), ("stuck-value", stuck)):
        if where.any():
            time = table.motion.time_s[where]
            flags.append(DataFlag(name, float(time[0]), float(time[-1]), int(where.sum())))
    return replace(table, used=table.used & ~(lost | ends | stuck)), tuple(flags)


def _stuck(table: LoadTable) -> NDArray[np.bool_]:
    """Return the readings that equal their neighbours although the load changed."""
    volts, torque = table.reading_v, table.torque_nm
    same = (np.diff(volts) == 0.0) & (np.diff(torque) != 0.0)
    stuck = np.zeros(len(volts), dtype=bool)
    start = 0
    for index, equal in enumerate([*same.tolist(), False]):
        if equal:
            continue
        if index + 1 - start >= _STUCK:
            stuck[start : index + 1] = True
        start = index + 1
    return stuck
