"""Two results of one kind held against each other, with their uncertainties."""

from __future__ import annotations

from hdbench.comparison.runs import compare_runs, comparison_csv

__all__ = ["compare_runs", "comparison_csv"]
