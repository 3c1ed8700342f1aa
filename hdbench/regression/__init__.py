"""Stored traces evaluated again and compared with stored results."""

from __future__ import annotations

from hdbench.regression.changes import Change, compare_results
from hdbench.regression.junit import write_junit
from hdbench.regression.report import CaseReport, RegressionReport, compare_folder
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
