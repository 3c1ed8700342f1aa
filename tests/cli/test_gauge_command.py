"""`hdbench gauge` draws the film and tells what a misplaced rosette does."""

import csv
import math
from pathlib import Path

import pytest


def test_the_film_of_the_report_has_its_46_mm(tmp_path, answer):
    out = tmp_path / "sub" / "film.pdf"
    body = answer("gauge", "film", "--out", out)
    assert body["schema"] == "hdbench/gauge-film/1"
    assert body["sizes_mm"]["flexspline ring, diameter"] == 46.0
    assert Path(body["files"]["pdf"]).read_bytes().startswith(b"%PDF")
    assert Path(body["files"]["svg"]).read_bytes().startswith(b"<?xml")


def test_an_unmeasured_boss_is_told(tmp_path, hdbench):
    _, told = hdbench("gauge", "film", "--out", tmp_path / "f.pdf")
    assert "boss not given" in told
    _, silent = hdbench("gauge", "film", "--boss", "21", "--out", tmp_path / "f.pdf")
    assert "boss" not in silent


def test_sizes_that_do_not_fit_exit_2_and_write_nothing(tmp_path, hdbench):
    out = tmp_path / "f.pdf"
    _, told = hdbench("gauge", "film", "--diameter", "nan", "--out", out, code=2)
    assert "--diameter" in told
    hdbench("gauge", "film", "--pad-length", "20", "--out", out, code=2)
    assert not out.exists()


@pytest.mark.parametrize(
    "words",
    [
        ("gauge", "errors", "--radial", "-1"),
        ("gauge", "errors", "--radial", "inf"),
        ("gauge", "errors", "--circumferential", "nan"),
        ("gauge", "errors", "--angular", "21"),
        ("gauge", "errors", "--draws", "99"),
        # ten times the range in which a foil gauge is linear, and past yield of any flexspline
        ("gauge", "errors", "--wave-strain", "0.01"),
        ("gauge", "film", "--line", "nan"),
        ("gauge", "film", "--sheet", "a5"),
        ("runs", "compare", "--confidence", "1"),
        ("runs", "compare", "--confidence", "0.5"),
        ("export", "--period", "0"),
        ("export", "--period", "nan"),
    ],
)
def test_a_number_out_of_its_range_is_refused_with_its_option(hdbench, words):
    _, told = hdbench(*words, code=2)
    assert words[-2] in told


def test_one_degree_is_told_in_newton_metres(tmp_path, answer):
    table = tmp_path / "errors.csv"
    words = ("--circumferential", "1", "--draws", "500", "--csv", table)
    body = answer("gauge", "errors", *words)
    assert body["schema"] == "hdbench/gauge-errors/1"
    row = next(r for r in body["one_off"] if r["kind"] == "circumferential")
    # 13.2 N m: 200 microstrain of a pair over 15.15 microstrain per N m
    assert row["closed_form_2_nm"] == pytest.approx(6.6 * math.sin(math.radians(1.0)), rel=1e-9)
    # grids 3.6 mm apart add normal strain in quadrature: 0.6 %
    assert row["effects"]["ripple_2_nm"] == pytest.approx(row["closed_form_2_nm"], rel=0.01)
    left = {w["order"]: w["left_by_layout"] for w in body["uncancelled_nm"]}
    assert left[2.0] < 1e-12
    assert left[4.0] == pytest.approx(1.0)
    assert "1 degree circumferential" in body["sentence"]
    rows = csv.DictReader(table.read_text().splitlines())
    told = {(r["kind"], r["rosette"], r["quantity"]): r["value"] for r in rows}
    value = float(told["circumferential", "1", "ripple_2_nm"])
    assert value == pytest.approx(row["effects"]["ripple_2_nm"], rel=1e-12)


def test_the_table_says_why_order_4_stays(hdbench):
    shown, _ = hdbench("gauge", "errors", "--draws", "100")
    assert "order 2: 13.2 N m uncancelled" in shown
    assert "they cancel" in shown
    assert "100 % of it stays" in shown
    assert "--layout spread" in shown
