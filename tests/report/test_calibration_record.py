"""The calibration record as a page and as a table."""

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

import pytest
from worked_example import masses

from hdbench.calibration import evaluate_calibration
from hdbench.profile import load_profile, parse_profile
from hdbench.records import Loads
from hdbench.records.jsonfile import result_header, write_json
from hdbench.report import write_report
from hdbench.report.calibration.section import pictures
from hdbench.report.source import Source

DECLARED = """
[standards.mass]
certificate = "<b>M-1</b>"
accuracy_class = "M1"

[standards.length]
half_width_m = 0.0001
"""


def readings() -> Loads:
    return masses(3, reading_std_v=1e-3, n_samples=100, temperature_c=21.0)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """Return the page and the record's table."""
    folder = tmp_path_factory.mktemp("record")
    profile = parse_profile(load_profile("cim-tr-97-06").text + DECLARED, "p")
    result = evaluate_calibration(
        readings(), max_consistency=0.05, bench=profile.data, monte_carlo_seed=0
    )
    header = result_header("calibration", profile)
    write_json(folder / "result.json", {**result.to_json(), **header})
    files = write_report([folder / "result.json"], folder / "page.html", profile=profile)
    return files.html.read_text(encoding="utf-8"), (folder / "page-record.csv").read_text()


def test_the_record_is_titled_and_unaccredited(record):
    page, _ = record
    assert "<h1>Calibration record</h1>" in page
    assert "Unaccredited; traceability as declared by the operator." in page
    assert "accredited laboratory" not in page.lower()
    assert "certificate of calibration" not in page.lower()


def test_the_record_holds_every_table_and_figure(record):
    page, _ = record
    step = "Evaluation step by step:"
    titles = {
        "What was calibrated", "Standards", "Gain and its uncertainty", "Consistency and spread",
        "Equation both ways", "Indicative class, in the manner of EURAMET cg-14", "Acceptance",
        "Uncertainty budget of the gain", "Applied torque, correction by correction",
        "Experiments, by the report&#39;s method", f"{step} clockwise, full range",
        f"{step} anticlockwise, full range", "Environment", "Warnings", "Readings", "Signatures",
        "Deviation from the line, full range", "Hysteresis and zero", "Gain of each experiment",
        "Budget", "Course of the calibration",
    }  # fmt: skip
    assert titles <= set(re.findall(r'<p class="figtitle">([^<]*)</p>', page))


def test_what_is_blank_is_shown_as_not_declared_and_text_is_escaped(record):
    page, _ = record
    assert "&lt;b&gt;M-1&lt;/b&gt;" in page
    assert "<b>M-1</b>" not in page
    cell = re.search(r"<td>instrument</td>\s*<td>([^<]*)</td><td>([^<]*)</td>", page)
    assert set(cell.groups()) == {"not declared"}


def test_the_uncertainty_is_stated_with_its_factor(record):
    page, _ = record
    stated = re.search(
        r"multiplied by k = (\d\.\d\d) \(from (\S+) effective degrees of freedom\)", page
    )
    # three positions: two degrees of freedom and a little more for what is known
    assert 4.0 < float(stated[1]) < 4.31
    assert "coverage probability is about 95 %" in page
    assert "Decision rule: simple acceptance" in page
    assert "Monte Carlo with 1000000 trials (seed 0)" in page


def test_loading_is_filled_and_unloading_open(record):
    page, _ = record
    start = page.index("Deviation from the line, full range")
    figure = page[start : page.index("</figure>", start)]
    assert "Filled: loading. Open: unloading." in figure
    assert "fill: var(--paper)" in figure
    assert "fill: var(--filtered)" in figure


def test_the_table_holds_one_number_in_a_row(record):
    _, text = record
    rows = list(csv.DictReader(io.StringIO(text)))
    parts = {row["part"] for row in rows}
    assert {"gain", "experiment", "step", "budget", "correction", "reading", "class"} <= parts
    deflections = [r for r in rows if r["name"] == "deflection_v" and r["group"] == "cw full"]
    assert len(deflections) == 4
    assert all(float(r["value"]) > 0.0 and r["unit"] == "V" for r in deflections)
    undeclared = [r for r in rows if r["part"] == "budget" and r["value"] == "not declared"]
    assert "local gravity" in {r["name"] for r in undeclared}


def test_preloads_and_shunt_readings_are_not_drawn_as_readings():
    loads = readings()
    shunt = replace(loads.readings[0], torque_nm=0.0, mass_kg=0.0, reading_v=9.9)
    kinds = (*["reading"] * len(loads), "shunt")
    more = Loads((*loads.readings, shunt), extra_columns={"kind": kinds})
    bench = load_profile("cim-tr-97-06").data
    result = evaluate_calibration(more, max_consistency=0.05, bench=bench)
    path = Path("loads.csv")
    source = Source(path, "calibration", "r", None, result=result, loads=more)
    (drawn,) = (p for p in pictures(source, "x", []) if "after figure" in p.title)
    assert drawn.caption.startswith(f"{len(loads)} readings of 6 ")
