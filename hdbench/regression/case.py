"""A regression case: stored input, how to evaluate it, what came out before."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from hdbench.errors import DataError
from hdbench.records import Quantity, TorqueScale
from hdbench.records.jsonfile import read_json
from hdbench.regression.tolerance import Tolerance
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
    profile: _Text
    filter: _Text | None = None
    gain_nm_per_v: Quantity | None = None
    options: dict[str, _Number] = Field(default_factory=dict)
    tolerances: dict[str, dict[str, object]] = Field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Case:
    """One stored input and how to evaluate it."""

    folder: Path
    kind: str
    source: Path
    # name of a built-in profile, or path of one
    profile: str
    # preset or model file; None takes the profile's
    filter_name: str | None
    # gain for volts; None takes the profile's, or ``torque_nm`` as it stands
    scale: TorqueScale | None
    options: dict[str, float]
    # they stand before the defaults
    tolerances: tuple[Tolerance, ...]

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.folder.name

    @property
    def expected(self) -> Path:
        """File with what came out before."""
        return self.folder / "expected.json"


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


def read_case(folder: Path) -> Case:
    """Read the case of one folder."""
    file = folder / "case.json"
    body = _CaseFile.from_json(read_json(file, _SCHEMA), str(file), _FIX)
    known = _OPTIONS.get(body.kind, set())
    for key in sorted(set(body.options) - known):
        raise DataError(
            f"unknown option of {body.kind}; known: {', '.join(sorted(known)) or 'none'}",
            where=f"{file}: options.{key}",
            fix=_FIX,
        )
    gain = body.gain_nm_per_v
    return Case(
        folder,
        body.kind,
        folder / body.input,
        _place(body.profile, ".toml", folder),
        None if body.filter is None else _place(body.filter, ".json", folder),
        None if gain is None else TorqueScale(gain, "regression case"),
        body.options,
        tuple(
            Tolerance.from_json(
                {"pattern": pattern, **item}, f"{file}: tolerances[{pattern!r}]", _FIX
            )
            for pattern, item in body.tolerances.items()
        ),
    )


def _place(name: str, suffix: str, folder: Path) -> str:
    """Return a file beside the case by its path, a built-in one by its name."""
    return str(folder / name) if name.endswith(suffix) else name
