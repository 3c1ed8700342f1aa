"""A comparison with stored results as JUnit XML, for the test pages of CI systems."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from hdbench.records.storage import write_atomic
from hdbench.regression.report import CaseReport, RegressionReport

# XML 1.0 has no place for other control characters, not even escaped
_ALLOWED_CONTROLS = "\t\n\r"


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
