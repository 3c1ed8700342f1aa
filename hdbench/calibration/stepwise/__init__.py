"""Evaluation step by step, in the manner of EURAMET cg-14."""

from __future__ import annotations

from hdbench.calibration.stepwise.classes import CLASSES, Classification, class_limit
from hdbench.calibration.stepwise.evaluation import GroupEvaluation, evaluate_group
from hdbench.calibration.stepwise.series import LoadSeries, StepGroup, step_groups

__all__ = [
    "CLASSES",
    "Classification",
    "GroupEvaluation",
    "LoadSeries",
    "StepGroup",
    "class_limit",
    "evaluate_group",
    "step_groups",
]
