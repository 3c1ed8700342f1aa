"""Stored cases evaluated again and held against their expected results, and that as JUnit XML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from hdbench import __version__
from hdbench.errors import DataError
from hdbench.records.jsonfile import read_json, write_json
from hdbench.records.storage import write_atomic
from hdbench.regression.case import EXPECTED_SCHEMA, Case, evaluate_case, find_cases
from hdbench.regression.changes import Change, compare_results

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
    counts = {
        "tests": str(len(report.cases)),
        "failures": str(failed),
        "errors": str(errors),
    }
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
