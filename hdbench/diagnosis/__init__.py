"""Measured against simulated: causes named, the model extended, the gain measured."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hdbench.diagnosis.answer.result import Diagnosis as Diagnosis
    from hdbench.diagnosis.dynamic import diagnose_trace as diagnose_trace
    from hdbench.diagnosis.run import DiagnosisOptions as DiagnosisOptions
    from hdbench.diagnosis.run import diagnose_run as diagnose_run
    from hdbench.diagnosis.run import diagnose_runs_together as diagnose_runs_together
    from hdbench.diagnosis.static import diagnose_loads as diagnose_loads

_PLACES = {
    "Diagnosis": "answer.result",
    "DiagnosisOptions": "run",
    "diagnose_loads": "static",
    "diagnose_run": "run",
    "diagnose_runs_together": "run",
    "diagnose_trace": "dynamic",
}


def __getattr__(name: str) -> Any:
    """Load what is asked for: plans and logs are read without the search."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
