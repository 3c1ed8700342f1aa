"""Measured against simulated: causes named, the model extended, the gain measured."""

from __future__ import annotations

from hdbench.diagnosis.answer.records import DataFlag
from hdbench.diagnosis.answer.result import Diagnosis, NamedCause, Pictures, Spectrum, Unexplained
from hdbench.diagnosis.dynamic import diagnose_trace
from hdbench.diagnosis.run import DiagnosisOptions, diagnose_run, diagnose_runs_together
from hdbench.diagnosis.static import diagnose_loads
from hdbench.diagnosis.together import diagnose_together

__all__ = [
    "DataFlag",
    "Diagnosis",
    "DiagnosisOptions",
    "NamedCause",
    "Pictures",
    "Spectrum",
    "Unexplained",
    "diagnose_loads",
    "diagnose_run",
    "diagnose_runs_together",
    "diagnose_together",
    "diagnose_trace",
]
