"""Gains of experiments: what scatters within and between positions, and what differs."""

from __future__ import annotations

from hdbench.calibration.gains.compare import (
    Consensus,
    PairedDifference,
    consensus,
    paired_difference,
)
from hdbench.calibration.gains.mixed import MixedFit, mixed_fit
from hdbench.calibration.gains.oneway import OneWay, one_way
from hdbench.calibration.gains.outliers import (
    GainOutlier,
    Outlier,
    extreme_values,
    gain_outliers,
    grubbs_limit,
)
from hdbench.calibration.gains.plainmean import plain_mean
from hdbench.calibration.gains.sideforce import (
    DirectionEffects,
    DirectionEntry,
    direction_effects,
)

__all__ = [
    "Consensus",
    "DirectionEffects",
    "DirectionEntry",
    "GainOutlier",
    "MixedFit",
    "OneWay",
    "Outlier",
    "PairedDifference",
    "consensus",
    "direction_effects",
    "extreme_values",
    "gain_outliers",
    "grubbs_limit",
    "mixed_fit",
    "one_way",
    "paired_difference",
    "plain_mean",
]
