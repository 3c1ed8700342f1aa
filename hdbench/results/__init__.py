"""Results as types: every key with unit and meaning, and the JSON that is made of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.records.jsonfile import read_json
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
    "read_result",
]


def read_result(file: Path) -> tuple[str, Mapping[str, Any], Any]:
    """Read the result of a run from its file.

    Parameters
    ----------
    file : Path
        A ``result.json``.

    Returns
    -------
    kind : str
        A key of `RESULT_TYPES`.
    stored : mapping
        Content of the file.
    result : Part
        The same, typed.

    Raises
    ------
    DataError
        If the file is damaged, or holds no result of such a kind.
    """
    stored = read_json(file)
    kind = str(stored.get("schema", "")).removeprefix("hdbench/").partition("/")[0]
    if kind not in RESULT_TYPES:
        raise DataError(
            f"schema is {stored.get('schema')!r:.60}; needed: one of "
            + ", ".join(f"hdbench/{name}/1" for name in RESULT_TYPES),
            where=f"{file}: schema",
            fix="name a run folder, or the result.json of one",
        )
    return kind, stored, RESULT_TYPES[kind].from_json(stored, str(file))
