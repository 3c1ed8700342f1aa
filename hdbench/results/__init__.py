"""Results as types: every key with unit and meaning, and the JSON that is made of them."""

from __future__ import annotations

from hdbench.results.calibration import CalibrationResult
from hdbench.results.dynamic import MisalignmentResult, RippleResult
from hdbench.results.parts import DataFlag, Part, ProfileName, Result

__all__ = [
    "CalibrationResult",
    "DataFlag",
    "MisalignmentResult",
    "Part",
    "ProfileName",
    "Result",
    "RippleResult",
]
