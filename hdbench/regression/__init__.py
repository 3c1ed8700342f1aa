"""Stored traces evaluated again and compared with stored results."""

from __future__ import annotations

from hdbench.regression.cases import RegressionReport, compare_folder, write_junit
from hdbench.regression.changes import Tolerance, compare_results

__all__ = ["RegressionReport", "Tolerance", "compare_folder", "compare_results", "write_junit"]
