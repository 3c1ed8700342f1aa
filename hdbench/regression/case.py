"""A regression case: stored input, how to evaluate it, what came out, then and with this code."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from hdbench.errors import DataError
from hdbench.evaluation import evaluate
from hdbench.filter import FilterModel, filter_trace, load_filter_model
from hdbench.profile import Profile, load_profile
from hdbench.profile.scaling import profile_scale, rescaled
from hdbench.records import Loads, Quantity, TorqueScale, Trace
from hdbench.records.jsonfile import read_json
from hdbench.records.loads import read_loads
from hdbench.records.tracefile import read_trace
from hdbench.regression.changes import read_tolerances
from hdbench.results import Part
from hdbench.results.dynamic import FilteredTrace
from hdbench.ripple import Stretch

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
# points of a filtered torque that are stored: enough to see where it moved
_POINTS = 50
# keys that name versions and identities, not results
_NO_RESULT = ("hdbench_version", "profile", "run", "doubts", "settings")
# keys of a diagnosis that its run folder adds
_OF_A_RUN = (
    *("input", "input_sha256", "torque_scale", "part", "inspection"),
    *("filter_gain", "separating_run"),
)


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


def evaluate_case(case: Case) -> dict[str, Any]:
    """Return the result of a case."""
    profile = load_profile(case.profile)
    records: Trace | Loads
    if case.kind == "calibration":
        records, scale = read_loads(case.source, profile.data.arm), profile_scale(profile)
    else:
        trace = read_trace(case.source)
        records, scale = rescaled(trace, profile, calibration=None, stored=case.scale)
    result = _result(case, profile, records, scale)
    return {key: value for key, value in result.items() if key not in _NO_RESULT}


def _result(
    case: Case, profile: Profile, records: Trace | Loads, scale: TorqueScale
) -> dict[str, Any]:
    if case.kind == "diagnosis" and isinstance(records, Trace):
        return _diagnosis(case, profile, records)
    model = load_filter_model(case.filter_name or profile.data.filter.model, profile.data)
    if case.kind == "filter" and isinstance(records, Trace):
        return _filtered(records, model, profile).to_json()
    stretch = Stretch(**case.options) if case.kind == "ripple" and case.options else None
    return evaluate(
        case.kind,
        records,
        profile,
        scale=scale,
        model=model,
        stretch=stretch,
        max_consistency=case.options.get("max_consistency"),
    ).to_json()


def _filtered(trace: Trace, model: FilterModel, profile: Profile) -> FilteredTrace:
    torque_nm = filter_trace(trace, model, profile.data).torque_filtered_nm
    good = torque_nm[np.isfinite(torque_nm)]
    at = np.linspace(0, len(good) - 1, min(_POINTS, len(good))).astype(int)
    return FilteredTrace(
        filter_name=model.name,
        n_samples=len(torque_nm),
        n_present=len(good),
        torque_filtered_rms_nm=float(np.sqrt(np.mean(good**2))),
        torque_filtered_min_nm=float(good.min()),
        torque_filtered_max_nm=float(good.max()),
        samples_nm=tuple(good[at].tolist()),
        sha256=hashlib.sha256(np.ascontiguousarray(torque_nm, dtype="<f8").tobytes()).hexdigest(),
    )


def _diagnosis(case: Case, profile: Profile, trace: Trace) -> dict[str, Any]:
    from hdbench.diagnosis import diagnose_trace
    from hdbench.diagnosis.run import part_of

    held, _ = part_of(trace, case.options.get("from_s"), case.options.get("to_s"))
    found = diagnose_trace(
        held,
        profile,
        alpha=float(case.options.get("alpha", 0.01)),
        materiality=float(case.options.get("materiality", 0.01)),
        seed=int(case.options.get("seed", 0)),
    )
    return {key: value for key, value in found.to_json().items() if key not in _OF_A_RUN}
