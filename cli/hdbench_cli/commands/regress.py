"""`hdbench regress`."""

from __future__ import annotations

from pathlib import Path

from hdbench.errors import DataError, HdbenchError, LimitError
from hdbench.regression import RegressionReport, compare_folder, write_junit
from hdbench_cli.output import Output
from hdbench_cli.text import Lines, styled

# lines per case on the screen: the rest is in --json
_MOST_LINES = 20


def regress_command(
    output: Output, folder: Path, update: bool, junit: Path | None, html_file: Path | None
) -> None:
    """Evaluate stored traces again and compare with stored results."""
    report = compare_folder(folder, update=update)
    if junit is not None:
        write_junit(junit, report)
    body = report.to_dict()
    if html_file is not None:
        from hdbench.report.regression import write_regression

        write_regression(body, html_file)
    written = [f"written  {file}" for file in (junit, html_file) if file is not None]
    output.result(body, [*_lines(report), *written], kind="regression")
    output.end(_verdict(report, folder))


def _lines(report: RegressionReport) -> Lines:
    """Yield what moved, case by case."""
    for case in report.cases:
        if case.error is not None:
            yield styled(("INVALID ", "bold red"), f"{case.name}: not compared")
            continue
        word, style = ("pass", "green") if case.passed else ("MOVED", "bold red")
        if case.updated and case.changes:
            word, style = "updated", "yellow"
        yield styled((f"{word:8}", style), f"{case.name}: {case.compared} quantities")
        if case.updated and not case.compared:
            yield f"  . first result kept: {len(case.changes)} quantities"
            continue
        for change in case.changes[:_MOST_LINES]:
            yield f"  {'!' if change.regression else '.'} {change.describe()}"
            if change.regression and change.what == "moved":
                yield styled((f"      tolerance: {change.reason}", "dim"))
        if len(case.changes) > _MOST_LINES:
            yield f"  and {len(case.changes) - _MOST_LINES} more: see --json"


def _verdict(report: RegressionReport, folder: Path) -> HdbenchError | None:
    """Return the error that the command ends with; None where everything passed."""
    if len(report.errors) == 1:
        return report.errors[0]
    if report.errors:
        return DataError(
            f"{len(report.errors)} cases cannot be compared",
            where=str(folder),
            fix="mend them one by one",
            problems=report.errors,
        )
    if report.passed:
        return None
    moved = [case for case in report.cases if not case.passed]
    names = ", ".join(
        f"{case.name}: {sum(change.regression for change in case.changes)} quantities"
        for case in moved
    )
    return LimitError(
        f"results moved beyond their tolerances ({names})",
        where=str(folder),
        fix="mend the code, or review the changes and keep them with --update",
    )
