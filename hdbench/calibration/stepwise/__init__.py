"""Evaluation step by step, in the manner of EURAMET cg-14."""

from __future__ import annotations

from hdbench.calibration.stepwise.classes import CLASSES, class_limit, overall_class
from hdbench.calibration.stepwise.evaluation import evaluate_group
from hdbench.calibration.stepwise.oddreadings import odd_readings
from hdbench.calibration.stepwise.series import LoadSeries, StepGroup, step_groups

__all__ = [
    "CLASSES",
    "LoadSeries",
    "StepGroup",
    "class_limit",
    "evaluate_group",
    "odd_readings",
    "overall_class",
    "step_groups",
]
