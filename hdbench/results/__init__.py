"""Results as types: every key with unit and meaning, and the JSON that is made of them."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.results.calibration import CalibrationResult
from hdbench.results.diagnosis import DiagnosisResult
from hdbench.results.dynamic import MisalignmentResult, RippleResult
from hdbench.results.parts import DataFlag, Part, ProfileName, Result

# kinds of run that have a result
RESULT_TYPES: Mapping[str, type[Part]] = {
    "calibration": CalibrationResult,
    "misalignment": MisalignmentResult,
    "ripple": RippleResult,
    "diagnosis": DiagnosisResult,
}

__all__ = [
    "RESULT_TYPES",
    "CalibrationResult",
    "DataFlag",
    "DiagnosisResult",
    "MisalignmentResult",
    "Part",
    "ProfileName",
    "Result",
    "RippleResult",
]
