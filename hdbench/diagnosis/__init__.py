"""Measured against simulated: causes named, the model extended, the gain measured."""

from __future__ import annotations

from hdbench.diagnosis.answer.result import Diagnosis
from hdbench.diagnosis.dynamic import diagnose_trace
from hdbench.diagnosis.run import DiagnosisOptions, diagnose_run, diagnose_runs_together
from hdbench.diagnosis.static import diagnose_loads

__all__ = [
    "Diagnosis",
    "DiagnosisOptions",
    "diagnose_loads",
    "diagnose_run",
    "diagnose_runs_together",
    "diagnose_trace",
]
