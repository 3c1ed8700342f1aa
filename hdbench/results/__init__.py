"""Results as types: every key with unit and meaning, and the JSON that is made of them."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.results.calibration import CalibrationResult
from hdbench.results.dynamic import MisalignmentResult, RippleResult
from hdbench.results.parts import DataFlag, Part, ProfileName, Result

# kinds of evaluation whose results are types
RESULT_TYPES: Mapping[str, type[CalibrationResult | MisalignmentResult | RippleResult]] = {
    "calibration": CalibrationResult,
    "misalignment": MisalignmentResult,
    "ripple": RippleResult,
}

__all__ = [
    "RESULT_TYPES",
    "CalibrationResult",
    "DataFlag",
    "MisalignmentResult",
    "Part",
    "ProfileName",
    "Result",
    "RippleResult",
]
