"""`hdbench runs compare` answers on the screen, as JSON, CSV and page, and by its exit code."""

import json
import re
from pathlib import Path

import pytest
from runkit import misalignment_result

from hdbench.records.jsonfile import dumps

STORED = Path(__file__).parents[1] / "stored" / "misalignment" / "expected.json"


def result(path: Path, amplitude: float) -> Path:
    body = json.loads(STORED.read_text())["result"] | misalignment_result(amplitude)
    profile = {"name": "<script>alert(1)</script>", "sha256": "0"}
    path.write_text(dumps({**body, "profile": profile}))
    return path


@pytest.fixture
def two(tmp_path: Path) -> tuple[Path, Path]:
    return result(tmp_path / "before.json", 5.0), result(tmp_path / "after.json", 0.9)


def test_the_answer_fits_one_screen_and_comes_first(two, hdbench):
    shown, _ = hdbench("runs", "compare", *two)
    lines = shown.splitlines()
    assert lines[0].startswith("MOVED  misalignment, peak to peak: 10 to 1.8 N m")
    assert len(lines) <= 24
    assert "a result file alone does not tell" in shown


def test_check_exits_3_where_something_moved_and_0_where_nothing_did(two, hdbench, answer):
    hdbench("runs", "compare", *two, "--check", code=3)
    hdbench("runs", "compare", two[0], two[0], "--check")
    body = answer("runs", "compare", *two, "--check", code=3)
    assert body["schema"] == "hdbench/comparison/1"
    assert body["verdict"] == "moved"


def test_two_kinds_and_a_missing_file_exit_4(two, tmp_path, hdbench):
    other = tmp_path / "other.json"
    ripple = json.loads((STORED.parents[1] / "ripple" / "expected.json").read_text())["result"]
    other.write_text(dumps(ripple))
    _, told = hdbench("runs", "compare", two[0], other, code=4)
    assert "two misalignment runs" in told
    hdbench("runs", "compare", two[0], tmp_path / "none.json", code=4)


def test_the_page_stands_alone_and_escapes_what_it_shows(two, tmp_path, hdbench):
    page, table = tmp_path / "sub" / "c.html", tmp_path / "c.csv"
    hdbench("runs", "compare", *two, "--html", page, "--csv", table)
    text = page.read_text()
    assert "Content-Security-Policy" in text
    assert not re.search(r"(src|href)=\"(https?:)?//", text)
    assert "<script>alert" not in text
    assert text.count("<svg") == 2
    assert "mathdefault" not in text
    assert json.loads(page.with_suffix(".json").read_text())["verdict"] == "moved"
    assert page.with_suffix(".csv").is_file()
    assert table.read_text().startswith("quantity,unit,a,")
    hdbench("runs", "compare", *two, "--html", tmp_path / "c.txt", code=2)
