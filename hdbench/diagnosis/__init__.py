"""Measured against simulated: causes named, the model extended, the gain measured."""

from __future__ import annotations

from hdbench.diagnosis.answer.records import DataFlag
from hdbench.diagnosis.answer.result import Diagnosis, NamedCause, Pictures, Spectrum, Unexplained
from hdbench.diagnosis.dynamic import diagnose_trace
from hdbench.diagnosis.run import DiagnosisOptions, diagnose_run
from hdbench.diagnosis.static import diagnose_loads

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
    "diagnose_trace",
]
