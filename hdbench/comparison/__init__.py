"""Two results of one kind held against each other, with their uncertainties."""

from __future__ import annotations

from hdbench.comparison.runs import Comparison, compare_runs, comparison_csv

__all__ = ["Comparison", "compare_runs", "comparison_csv"]
