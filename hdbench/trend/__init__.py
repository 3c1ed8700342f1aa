"""One quantity over many runs: control charts, changes of the level, drift."""

from __future__ import annotations

from hdbench.trend.quantities import QUANTITIES
from hdbench.trend.trend import trend_csv, trend_of_runs

__all__ = ["QUANTITIES", "trend_csv", "trend_of_runs"]
