"""Static readings to a torque gain: the report's calibration."""

from __future__ import annotations

from hdbench.calibration.evaluation import evaluate_calibration
from hdbench.calibration.lines import ExperimentLine, fit_experiment
from hdbench.calibration.result import CalibrationResult
from hdbench.calibration.statistics import consistency_interval, mean_gain
from hdbench.calibration.steps import LoadStep

__all__ = [
    "CalibrationResult",
    "ExperimentLine",
    "LoadStep",
    "consistency_interval",
    "evaluate_calibration",
    "fit_experiment",
    "mean_gain",
]
