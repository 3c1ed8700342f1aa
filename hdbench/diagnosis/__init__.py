"""Measured against simulated: causes named, the model extended, the gain measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdbench import handed_out

if TYPE_CHECKING:
    from hdbench.diagnosis.answer.result import Diagnosis as Diagnosis
    from hdbench.diagnosis.dynamic import diagnose_trace as diagnose_trace
    from hdbench.diagnosis.run import DiagnosisOptions as DiagnosisOptions
    from hdbench.diagnosis.run import diagnose_run as diagnose_run
    from hdbench.diagnosis.run import diagnose_runs_together as diagnose_runs_together
    from hdbench.diagnosis.static import diagnose_loads as diagnose_loads

# plans and logs are read without the search
__getattr__ = handed_out(
    __name__,
    {
        "Diagnosis": "answer.result",
        "DiagnosisOptions": "run",
        "diagnose_loads": "static",
        "diagnose_run": "run",
        "diagnose_runs_together": "run",
        "diagnose_trace": "dynamic",
    },
)
