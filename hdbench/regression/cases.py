"""Regression cases: stored inputs evaluated again and held against what is expected of them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal
from xml.etree import ElementTree

import numpy as np
from pydantic import Field

from hdbench import __version__
from hdbench.errors import DataError
from hdbench.evaluation import evaluate
from hdbench.filter import FilterModel, filter_trace, load_filter_model
from hdbench.profile import Profile, load_profile
from hdbench.profile.scaling import profile_scale, rescaled
from hdbench.records import Loads, Quantity, TorqueScale, Trace
from hdbench.records.jsonfile import read_json, write_json
from hdbench.records.loads import read_loads
from hdbench.records.storage import write_atomic
from hdbench.records.tracefile import read_trace
from hdbench.regression.changes import Change, compare_results, read_tolerances
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


# XML 1.0 has no place for other control characters, not even escaped
_ALLOWED_CONTROLS = "\t\n\r"


@dataclass(frozen=True, slots=True)
class CaseReport:
    """What one case showed.

    Parameters
    ----------
    name, kind : str
        Name of its folder and kind of evaluation.
    compared : int
        Quantities compared.
    changes : tuple of Change
        What is not what it was, regressions first.
    updated : bool
        Whether the expected results were written anew.
    error : DataError or None
        Why the case could not be compared at all.
    """

    name: str
    kind: str
    compared: int
    changes: tuple[Change, ...]
    updated: bool
    error: DataError | None = None

    @property
    def passed(self) -> bool:
        """True where the case was compared and nothing moved beyond its tolerance."""
        return self.error is None and not any(change.regression for change in self.changes)


@dataclass(frozen=True, slots=True)
class RegressionReport:
    """What all cases of a folder showed.

    Parameters
    ----------
    folder : str
        The folder.
    cases : tuple of CaseReport
        In the order of their names.
    """

    folder: str
    cases: tuple[CaseReport, ...]

    @property
    def passed(self) -> bool:
        """True where every case passed or was updated."""
        return all(case.passed or case.updated for case in self.cases)

    @property
    def errors(self) -> tuple[DataError, ...]:
        """Why cases could not be compared, one error each."""
        return tuple(case.error for case in self.cases if case.error is not None)

    def to_dict(self) -> dict[str, Any]:
        """Return the report as ``--json`` prints it (schema ``hdbench/regression/1``)."""
        return {
            "schema": "hdbench/regression/1",
            "hdbench_version": __version__,
            "folder": self.folder,
            "passed": self.passed,
            "cases": [
                {
                    "name": case.name,
                    "kind": case.kind,
                    "passed": case.passed,
                    "updated": case.updated,
                    "compared": case.compared,
                    "changes": [asdict(change) for change in case.changes],
                    "error": None if case.error is None else case.error.to_dict(),
                }
                for case in self.cases
            ],
        }


def compare_folder(folder: Path, *, update: bool = False) -> RegressionReport:
    """Evaluate every case of a folder again and compare it with its expected result.

    Parameters
    ----------
    folder : Path
        Folder of cases, or one case.
    update : bool
        Write what comes out as the expected result, after comparing.

    Returns
    -------
    RegressionReport
        A regression is reported, not raised, and so is a case that cannot be compared.

    Raises
    ------
    DataError
        If there is no case.
    StorageError
        If an expected result cannot be written.
    """
    places = find_cases(Path(folder))
    cases = []
    for place in places:
        try:
            cases.append(_run(Case(place), update))
        except DataError as error:
            cases.append(CaseReport(Path(place).name, "unknown", 0, (), False, error))
    return RegressionReport(str(folder), tuple(cases))


def _run(case: Case, update: bool) -> CaseReport:
    found = evaluate_case(case)
    if not case.expected.is_file() and not update:
        raise DataError(
            "no expected.json; needed: the result to compare with",
            where=str(case.expected.parent),
            fix="run hdbench regress --update once, look at the result, and keep it",
        )
    before = _expected(case) if case.expected.is_file() else {}
    changes, compared = compare_results(before, found, case.tolerances)
    if update:
        write_json(
            case.expected,
            {"schema": EXPECTED_SCHEMA, "hdbench_version": __version__, "result": found},
        )
    return CaseReport(case.name, case.kind, compared, changes, update)


def _expected(case: Case) -> Mapping[str, Any]:
    result = read_json(case.expected, EXPECTED_SCHEMA).get("result")
    if not isinstance(result, Mapping):
        raise DataError(
            f"key 'result' is {result!r:.60}; needed: an object",
            where=f"{case.expected}: result",
            fix="write it again with hdbench regress --update",
        )
    return result


def write_junit(file: Path, report: RegressionReport) -> None:
    """Write one test case per stored case; a failure names every quantity that moved.

    Parameters
    ----------
    file : Path
        XML file; written whole or not at all.
    report : RegressionReport
        What the comparison showed.

    Raises
    ------
    StorageError
        If the file cannot be written.

    Notes
    -----
    The form is the one that the CI systems read in common: ``testsuites`` with one ``testsuite``,
    a ``testcase`` each, in it ``error`` where it could not be compared, ``failure`` where something
    moved and ``system-out`` for what changed within what is allowed.
    """
    errors = len(report.errors)
    failed = sum(not case.passed for case in report.cases) - errors
    counts = {"tests": str(len(report.cases)), "failures": str(failed), "errors": str(errors)}
    root = ElementTree.Element("testsuites", counts)
    suite = ElementTree.SubElement(root, "testsuite", {"name": _plain(report.folder), **counts})
    for case in report.cases:
        _add_case(suite, case)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    write_atomic(Path(file), text + b"\n")


def _add_case(suite: ElementTree.Element, case: CaseReport) -> None:
    at = {"classname": f"hdbench.regress.{_plain(case.kind)}", "name": _plain(case.name)}
    element = ElementTree.SubElement(suite, "testcase", at)
    moved = [change.describe() for change in case.changes if change.regression]
    told = [change.describe() for change in case.changes if not change.regression]
    if case.error is not None:
        found = {"message": _plain(case.error.what), "type": case.error.kind}
        ElementTree.SubElement(element, "error", found).text = _plain(str(case.error))
    if moved:
        message = f"{len(moved)} of {case.compared} quantities moved beyond their tolerance"
        failure = ElementTree.SubElement(
            element, "failure", {"message": message, "type": "regression"}
        )
        failure.text = _plain("\n".join(moved))
    if told:
        ElementTree.SubElement(element, "system-out").text = _plain("\n".join(told))


def _plain(text: str) -> str:
    return "".join(c if c.isprintable() or c in _ALLOWED_CONTROLS else "?" for c in text)
