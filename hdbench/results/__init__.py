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


def kind_of(body: Mapping[str, Any]) -> str:
    """Return the kind of a result: ``calibration`` for ``hdbench/calibration/1``."""
    return str(body.get("schema", "")).removeprefix("hdbench/").partition("/")[0]


def typed_result(body: Mapping[str, Any], where: str) -> Any:
    """Return a stored result as its type; None where its kind has none."""
    kind = RESULT_TYPES.get(kind_of(body))
    return None if kind is None else kind.from_json(body, where)


def read_result(path: Path) -> tuple[dict[str, Any], Any]:
    """Read the result of a run: its file, and the same as its type.

    Parameters
    ----------
    path : Path
        A ``result.json``.

    Returns
    -------
    body : dict
        Content of the file.
    result : CalibrationResult, MisalignmentResult, RippleResult or DiagnosisResult

    Raises
    ------
    DataError
        If the file cannot be read or is no such result.
    """
    body = read_json(path)
    result = typed_result(body, str(path))
    if result is None:
        raise DataError(
            f"schema is {body.get('schema')!r:.60}; needed: one of "
            + ", ".join(f"hdbench/{name}/1" for name in RESULT_TYPES),
            where=f"{path}: schema",
            fix="name a run folder, or the result.json of one",
        )
    return body, result


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
    "kind_of",
    "read_result",
    "typed_result",
]
