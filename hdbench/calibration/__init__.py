"""Static readings to a torque gain: the report's calibration."""

from __future__ import annotations

from hdbench.calibration.evaluation import evaluate_calibration
from hdbench.calibration.gains import consistency_interval

__all__ = ["consistency_interval", "evaluate_calibration"]
