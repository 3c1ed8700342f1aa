"""Constant-velocity runs to the misalignment torque and its block of the filter."""

from __future__ import annotations

from hdbench.misalignment.evaluation import evaluate_misalignment
from hdbench.misalignment.result import MisalignmentResult

__all__ = ["MisalignmentResult", "evaluate_misalignment"]
