"""A regression case: stored input, how to evaluate it, what came out before."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from hdbench.errors import DataError
from hdbench.records import Quantity, TorqueScale
from hdbench.records.jsonfile import read_json
from hdbench.regression.tolerance import read_tolerances
from hdbench.results import Part

EXPECTED_SCHEMA = "hdbench/regression-expected/1"
_SCHEMA = "hdbench/regression-case/1"
_FIX = "correct the case file"
_Kind = Literal["calibration", "misalignment", "ripple", "filter", "diagnosis"]
_Text = Annotated[str, Field(min_length=1)]
_Number = Annotated[float, Field(strict=True)]
_OPTIONS: dict[str, set[str]] = {
    "calibration": {"max_consistency"},
    "ripple": {"velocity_above_rad_s", "from_s", "to_s"},
    "diagnosis": {"alpha", "materiality", "seed", "from_s", "to_s"},
}


class _CaseFile(Part, closed=True):
    """Content of ``case.json``."""

    schema: str
    kind: _Kind
    input: _Text
    # name of a built-in profile, or a file beside the case
    profile: _Text
    # preset or model file; None takes the profile's
    filter: _Text | None = None
    # for volts; None takes the profile's, or ``torque_nm`` as it stands
    gain_nm_per_v: Quantity | None = None
    options: dict[str, _Number] = Field(default_factory=dict)
    # they stand before the defaults
    tolerances: dict[str, dict[str, object]] = Field(default_factory=dict)


class Case:
    """One stored input and how to evaluate it."""

    def __init__(self, folder: Path) -> None:
        file = folder / "case.json"
        told = _CaseFile.from_json(read_json(file, _SCHEMA), str(file), _FIX)
        known = _OPTIONS.get(told.kind, set())
        for key in sorted(set(told.options) - known):
            raise DataError(
                f"unknown option of {told.kind}; known: {', '.join(sorted(known)) or 'none'}",
                where=f"{file}: options.{key}",
                fix=_FIX,
            )
        gain = told.gain_nm_per_v
        self.name, self.kind, self.options = folder.name, told.kind, told.options
        self.source, self.expected = folder / told.input, folder / "expected.json"
        self.profile = _place(told.profile, ".toml", folder)
        self.filter_name = told.filter and _place(told.filter, ".json", folder)
        self.scale = None if gain is None else TorqueScale(gain, "regression case")
        self.tolerances = read_tolerances(told.tolerances, f"{file}: tolerances", _FIX)


def find_cases(folder: Path) -> tuple[Path, ...]:
    """Return the folders of all cases: `folder` itself, or those below it that hold a case."""
    folder = Path(folder)
    if (folder / "case.json").is_file():
        return (folder,)
    found = tuple(sorted(file.parent for file in folder.glob("*/case.json")))
    if not found:
        raise DataError(
            "no case.json in this folder or in one below it; needed: at least one",
            where=str(folder),
            fix="name a folder of regression cases, such as tests/stored",
        )
    return found


def _place(name: str, suffix: str, folder: Path) -> str:
    """Return a file beside the case by its path, a built-in one by its name."""
    return str(folder / name) if name.endswith(suffix) else name
