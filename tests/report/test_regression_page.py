"""The page of a comparison with stored results."""

import csv
import json
from typing import Any

import pytest

from hdbench.errors import UsageError
from hdbench.report.regression import write_regression


def _change(key: str, **cells: Any) -> dict[str, Any]:
    told = {"key": key, "what": "moved", "reason": "two per cent <of> it", "regression": True}
    numbers = {"expected": 0.5, "found": 0.25, "allowed": 0.125, "in_tolerances": 2.0}
    return {**told, **numbers, **cells}


def _body(*changes: dict[str, Any], error: dict[str, Any] | None = None) -> dict[str, Any]:
    passed = error is None and not any(change["regression"] for change in changes)
    case = {"name": "a<b", "kind": "ripple", "passed": passed, "updated": False, "compared": 7}
    case |= {"changes": list(changes), "error": error}
    head = {"schema": "hdbench/regression/1", "hdbench_version": "0", "folder": "stored"}
    return {**head, "passed": passed, "cases": [case]}


def test_what_moved_stands_on_the_page_with_its_tolerance_and_its_reason(tmp_path):
    files = write_regression(_body(_change("x.y"), _change("z", what="new")), tmp_path / "r.html")
    page = files.html.read_text()
    assert "Moved: 2 of 7 quantities" in page
    for cell in ("x.y", "0.5", "0.25", "0.125", "two per cent &lt;of&gt; it", "a&lt;b"):
        assert cell in page
    assert "a<b" not in page
    assert page.count("<svg") == 1
    rows = list(csv.DictReader(files.csv.read_text().splitlines()))
    assert [row["key"] for row in rows] == ["x.y", "z"]
    assert json.loads(files.json.read_text())["cases"][0]["compared"] == 7


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (_body(), "Nothing moved: 7 quantities"),
        (
            _body(_change("s", what="changed", in_tolerances=None, allowed=None, regression=False)),
            "Changed, but allowed",
        ),
        (_body(error={"where": "case.json:1", "what": "no JSON", "fix": "mend it"}), "case.json:1"),
    ],
)
def test_a_case_that_passed_and_one_that_is_broken_are_told_as_such(body, words, tmp_path):
    page = write_regression(body, tmp_path / "r.html").html.read_text()
    assert words in page
    assert "<svg" not in page
    assert "default-src 'none'" in page


def test_a_page_is_written_again_over_itself_and_over_an_empty_file(tmp_path):
    (tmp_path / "r.csv").touch()
    first, again = (
        write_regression(_body(_change("x")), tmp_path / "r.html").html.read_bytes()
        for _ in range(2)
    )
    assert first == again
    with pytest.raises(UsageError, match=r"\.html"):
        write_regression(_body(), tmp_path / "r.txt")


@pytest.mark.parametrize("ending", [".csv", ".json", ".html"])
def test_a_file_of_somebody_else_is_left_as_it_is(tmp_path, ending):
    mine = tmp_path / f"r{ending}"
    mine.write_text("time_s,torque_nm\n0,1\n")
    with pytest.raises(UsageError, match="no report's") as caught:
        write_regression(_body(), tmp_path / "r.html")
    assert caught.value.where == str(mine)
    assert mine.read_text() == "time_s,torque_nm\n0,1\n"
    assert list(tmp_path.iterdir()) == [mine]
