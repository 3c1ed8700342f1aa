"""Samples that no model of Gaussian noise explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hdbench.filter.assemble import state_space
from hdbench.filter.channels import Channels
from hdbench.filter.kalman import new_state, run
from hdbench.filter.layout import GATED
from hdbench.filter.model import FilterModel

__all__ = ["without_outliers"]


def without_outliers(
    model: FilterModel, records: Sequence[Channels], gate_sigma: float
) -> tuple[list[Channels], int]:
    """Return the traces with the torque of outliers missing.

    Notes
    -----
    The set is fixed before the likelihood is maximised again: a gate inside of the likelihood
    would reward small noise, under which more samples are refused. Where the gate refuses as many
    samples in a row as it may, the torque has moved: a step of the load is no outlier.
    """
    space = state_space(replace(model, gate_sigma=gate_sigma))
    kept, outliers = [], 0
    for record in records:
        found = run(
            space,
            new_state(space),
            record.time_s,
            record.velocity_rad_s,
            record.torque_nm,
            angle_rad=record.angle_rad,
        )
        refused = _short_runs((found.flags & GATED) != 0, space.gate_samples)
        count = int(np.count_nonzero(refused))
        if count:
            record = replace(record, torque_nm=np.where(refused, np.nan, record.torque_nm))
        outliers += count
        kept.append(record)
    return kept, outliers


def _short_runs(refused: NDArray[np.bool_], longest: int) -> NDArray[np.bool_]:
    """Return the samples of runs shorter than `longest`."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], refused.astype(np.int8), [0]))))
    kept = refused.copy()
    for first, after in edges.reshape(-1, 2).tolist():
        if after - first >= longest:
            kept[first:after] = False
    return kept
