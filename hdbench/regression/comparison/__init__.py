"""Two results of one kind held against each other, with their uncertainties."""

from __future__ import annotations

from hdbench.regression.comparison.compare import compare_runs
from hdbench.regression.comparison.result import Comparison, comparison_csv

__all__ = ["Comparison", "compare_runs", "comparison_csv"]
