"""A regression case: stored input, how to evaluate it, what came out before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.records import Quantity, TorqueScale
from hdbench.records.jsonfile import read_json
from hdbench.regression.tolerance import Tolerance, read_tolerances

__all__ = ["CASE_SCHEMA", "EXPECTED_SCHEMA", "KINDS", "Case", "find_cases", "read_case"]

CASE_SCHEMA = "hdbench/regression-case/1"
EXPECTED_SCHEMA = "hdbench/regression-expected/1"
KINDS = ("calibration", "misalignment", "ripple", "filter", "diagnosis")
_KEYS = {"schema", "kind", "input", "profile", "filter", "gain_nm_per_v", "options", "tolerances"}
_OPTIONS: dict[str, set[str]] = {
    "calibration": {"max_consistency"},
    "misalignment": set(),
    "ripple": {"velocity_above_rad_s", "from_s", "to_s"},
    "filter": set(),
    "diagnosis": {"alpha", "materiality", "seed", "from_s", "to_s"},
}


@dataclass(frozen=True, slots=True)
class Case:
    """One stored input and how to evaluate it.

    Parameters
    ----------
    folder : Path
        Folder of the case.
    kind : str
        ``calibration``, ``misalignment``, ``ripple``, ``filter`` or ``diagnosis``.
    source : Path
        Trace or loads file.
    profile : str
        Name of a built-in profile, or path of one.
    filter_name : str or None
        Filter preset or model file; None takes the profile's.
    scale : TorqueScale or None
        Gain for volts; None takes the profile's, or ``torque_nm`` as it stands.
    options : mapping
        Numbers that the evaluation takes.
    tolerances : tuple of Tolerance
        Own tolerances; they stand before the defaults.
    """

    folder: Path
    kind: str
    source: Path
    profile: str
    filter_name: str | None
    scale: TorqueScale | None
    options: Mapping[str, float]
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
    body = read_json(file, CASE_SCHEMA)
    for key in sorted(set(body) - _KEYS):
        raise _bad(f"unknown key {key!r}; known: {', '.join(sorted(_KEYS))}", f"{file}: {key}")
    kind = body.get("kind")
    if kind not in KINDS:
        raise _bad(f"kind is {kind!r}; needed: one of {', '.join(KINDS)}", f"{file}: kind")
    return Case(
        folder,
        kind,
        folder / _text(body, "input", file),
        _profile(_text(body, "profile", file), folder),
        _filter(body, folder, file),
        _scale(body.get("gain_nm_per_v"), file),
        _options(body.get("options", {}), kind, file),
        read_tolerances(body.get("tolerances"), str(file)),
    )


def _bad(what: str, where: str) -> DataError:
    return DataError(what, where=where, fix="correct the case file")


def _text(body: Mapping[str, Any], key: str, file: Path) -> str:
    value = body.get(key)
    if not (isinstance(value, str) and value):
        raise _bad(f"{key} is {value!r}; needed: text", f"{file}: {key}")
    return value


def _profile(name: str, folder: Path) -> str:
    return str(folder / name) if name.endswith(".toml") else name


def _filter(body: Mapping[str, Any], folder: Path, file: Path) -> str | None:
    if "filter" not in body:
        return None
    name = _text(body, "filter", file)
    return str(folder / name) if name.endswith(".json") else name


def _scale(body: Any, file: Path) -> TorqueScale | None:
    if body is None:
        return None
    try:
        gain = Quantity(float(body["value"]), float(body["std"]), body.get("dof"))
    except (KeyError, TypeError, ValueError) as error:
        raise _bad(
            f"gain_nm_per_v is {body!r:.80}; needed: an object with value, std and dof, N m/V",
            f"{file}: gain_nm_per_v",
        ) from error
    return TorqueScale(gain, "regression case")


def _options(body: Any, kind: str, file: Path) -> dict[str, float]:
    if not isinstance(body, Mapping):
        raise _bad(f"options is a {type(body).__name__}; needed: an object", f"{file}: options")
    for key, value in body.items():
        known = ", ".join(sorted(_OPTIONS[kind])) or "none"
        if key not in _OPTIONS[kind]:
            raise _bad(f"unknown option of {kind}; known: {known}", f"{file}: options.{key}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise _bad(f"found {value!r}; needed: a number", f"{file}: options.{key}")
    return dict(body)
