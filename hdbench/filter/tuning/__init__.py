"""Noise of a filter model by maximum likelihood of its innovations."""

from __future__ import annotations

from hdbench.filter.tuning.checks import Consistency, check_innovations
from hdbench.filter.tuning.result import TuningResult
from hdbench.filter.tuning.run import TuningSettings, settings_of, tune

__all__ = [
    "Consistency",
    "TuningResult",
    "TuningSettings",
    "check_innovations",
    "settings_of",
    "tune",
]
