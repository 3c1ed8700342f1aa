"""Stored inputs evaluated again and held against what came out before."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.records.jsonfile import read_json, write_json
from hdbench.regression.case import EXPECTED_SCHEMA, Case, find_cases, read_case
from hdbench.regression.evaluate import evaluate_case
from hdbench.regression.outcome import CaseReport, Change, RegressionReport
from hdbench.regression.tolerance import Tolerance, tolerance_for
from hdbench.results.flatten import Leaf, flatten

__all__ = ["compare_folder", "compare_results"]


def compare_folder(
    folder: Path, *, update: bool = False, keep_going: bool = False
) -> RegressionReport:
    """Evaluate every case of a folder again and compare it with its expected result.

    Parameters
    ----------
    folder : Path
        Folder of cases, or one case.
    update : bool
        Write what comes out as the expected result, after comparing.
    keep_going : bool
        Tell of a case that cannot be compared in its report instead of raising, and go on.

    Returns
    -------
    RegressionReport
        A regression is reported, not raised.

    Raises
    ------
    DataError
        If there is no case; unless `keep_going`, if a case or its input is invalid or it has no
        expected result.
    StorageError
        If an expected result cannot be written.
    """
    places = find_cases(Path(folder))
    cases = []
    for place in places:
        try:
            cases.append(_run(read_case(place), update))
        except DataError as error:
            if not keep_going:
                raise
            cases.append(CaseReport(Path(place).name, "unknown", 0, (), False, error))
    return RegressionReport(str(folder), tuple(cases))


def _run(case: Case, update: bool) -> CaseReport:
    found = evaluate_case(case)
    if not case.expected.is_file() and not update:
        raise DataError(
            "no expected.json; needed: the result to compare with",
            where=str(case.folder),
            fix="run hdbench regress --update once, look at the result, and keep it",
        )
    before = _expected(case) if case.expected.is_file() else {}
    changes, compared = compare_results(before, found, case.tolerances)
    if update:
        from hdbench import __version__

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


def compare_results(
    expected: Mapping[str, Any], found: Mapping[str, Any], own: tuple[Tolerance, ...] = ()
) -> tuple[tuple[Change, ...], int]:
    """Compare two results quantity by quantity.

    Parameters
    ----------
    expected, found : mapping
        Results before and now.
    own : tuple of Tolerance
        Tolerances that stand before the defaults.

    Returns
    -------
    changes : tuple of Change
        Regressions first, the farthest moved first among them.
    compared : int
        How many quantities are in both.
    """
    before, now = flatten(expected), flatten(found)
    changes = [
        change
        for key in before.keys() & now.keys()
        if (change := _compare(key, before, now[key], own)) is not None
    ]
    for key in before.keys() - now.keys():
        rule = tolerance_for(key, own)
        changes.append(
            Change(key, "missing", before[key], None, None, None, rule.reason, not rule.note_only)
        )
    changes += [
        Change(key, "new", None, now[key], None, None, "keys may be added", False)
        for key in now.keys() - before.keys()
    ]
    changes.sort(key=_rank)
    return tuple(changes), len(before.keys() & now.keys())


def _rank(change: Change) -> tuple[bool, float, str]:
    far = math.inf if change.in_tolerances is None else change.in_tolerances
    return not change.regression, -far, change.key


def _number(value: Leaf) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value)


def _compare(
    key: str, before: Mapping[str, Leaf], found: Leaf, own: tuple[Tolerance, ...]
) -> Change | None:
    rule, expected = tolerance_for(key, own), before[key]
    old, new = _number(expected), _number(found)
    if old is None or new is None:
        if expected == found and type(expected) is type(found):
            return None
        regression = not rule.note_only
        return Change(key, "changed", expected, found, None, None, rule.reason, regression)
    std = before.get(f"{key.removesuffix('.value')}.std") if key.endswith(".value") else None
    allowed = rule.allowed(old, _number(std))
    distance = abs(new - old)
    if "phase_rad" in key and not key.endswith(".std"):
        distance = abs(math.remainder(new - old, 2.0 * math.pi))
    if distance <= allowed:
        return None
    share = distance / allowed if allowed > 0.0 else None
    return Change(key, "moved", expected, found, allowed, share, rule.reason, not rule.note_only)
