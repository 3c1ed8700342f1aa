"""Stored traces evaluated again and compared with stored results."""

from __future__ import annotations

from hdbench.regression.compare import compare_folder, compare_results
from hdbench.regression.junit import write_junit
from hdbench.regression.outcome import CaseReport, Change, RegressionReport
from hdbench.regression.tolerance import Tolerance

__all__ = [
    "CaseReport",
    "Change",
    "RegressionReport",
    "Tolerance",
    "compare_folder",
    "compare_results",
    "write_junit",
]
