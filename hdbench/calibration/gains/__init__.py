"""Gains of experiments: scatter within and between positions, differences, outliers."""

from __future__ import annotations

from hdbench.calibration.gains.differences import (
    DirectionEntry,
    consensus,
    direction_effects,
    direction_entries,
    paired_difference,
    side_force,
)
from hdbench.calibration.gains.mixed import mixed_fit, plain_mean
from hdbench.calibration.gains.outliers import (
    GainOutlier,
    extreme_values,
    gain_outliers,
    grubbs_limit,
)
from hdbench.calibration.gains.positions import (
    any_one_position,
    by_position,
    mean_gain,
    one_way,
    position_numbers,
)

__all__ = [
    "DirectionEntry",
    "GainOutlier",
    "any_one_position",
    "by_position",
    "consensus",
    "direction_effects",
    "direction_entries",
    "extreme_values",
    "gain_outliers",
    "grubbs_limit",
    "mean_gain",
    "mixed_fit",
    "one_way",
    "paired_difference",
    "plain_mean",
    "position_numbers",
    "side_force",
]
