"""One quantity over runs: which runs count, how they are grouped, what is said and shown."""

import csv
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from runkit import write_run

from hdbench.errors import DataError
from hdbench.records import add_note, list_runs
from hdbench.trend import QUANTITIES, trend_of_runs
from hdbench_cli.options import declared

START = datetime(2025, 1, 1, tzinfo=UTC)


STORED = Path(__file__).parents[1] / "stored"
KINDS = ("calibration", "misalignment", "ripple")
# keys that these tests do not look at
NEEDED = {
    kind: json.loads((STORED / kind / "expected.json").read_text())["result"] for kind in KINDS
}
LOOP = next(iter(NEEDED["calibration"]["hysteresis"].values()))
LINE = NEEDED["calibration"]["experiments"][0]
NUMBER = {"value": 0.9, "std": 0.1, "dof": None}
STRETCH = {**NEEDED["misalignment"]["stretches"][0], "offset_nm": NUMBER}


def utc(day):
    return (START + timedelta(days=day)).isoformat().replace("+00:00", "Z")


def add(parent, day, kind="calibration", drive="A", result=None, data=None, **manifest):
    """Write the folder of a run that was measured on a day."""
    if result is not None:
        result = {"doubts": [], "flags": [], **NEEDED.get(kind, {}), **result}
    files = {"loads.csv": data or f"{kind}{day}{drive}"}
    times = {"started_utc": utc(day), "ended_utc": utc(day)}
    folder = parent / f"{day:04d}-{kind}-{drive}"
    return write_run(folder, kind, result, **{**times, "drive": drive, "files": files, **manifest})


def gain(value, std=0.01, **more):
    return {
        "gain_nm_per_v": {"value": value, "std": std, "dof": 3},
        "accepted": True,
        "validity_days": 365.0,
        **more,
    }


def trend(parent, quantity="gain", day=300, **options):
    return trend_of_runs(list_runs(parent), quantity, now=START + timedelta(days=day), **options)


@pytest.fixture
def year(tmp_path):
    """A stable drive, and one whose gain steps after a new clamping."""
    draw = np.random.default_rng(1)
    for k in range(30):
        add(tmp_path, 10 * k, result=gain(6.6 + 0.02 * draw.normal()))
        stepped = 6.6 + 0.02 * draw.normal() + (0.1 if k >= 20 else 0.0)
        folder = add(tmp_path, 10 * k, drive="B", result=gain(stepped))
        if k == 20:
            add_note(folder, "re-clamped <i>", START)
    return tmp_path


def test_each_drive_is_a_history_of_its_own_and_a_step_is_told_with_its_mark(year):
    stable, stepped = trend(year)["groups"]
    assert (stable["name"], stable["signals"], stable["change_points"]) == ("A", [], [])
    (change,) = stepped["change_points"]
    assert change["run"] == "0200-calibration-B"
    assert change["marks"] == ["re-clamped <i>"]
    assert abs(change["step"]["value"] - 0.1) < 4 * change["step"]["std"]
    assert {signal["run"] for signal in stepped["signals"]} >= {"0200-calibration-B"}


def test_runs_that_do_not_count_are_named_with_the_reason(tmp_path):
    add(tmp_path, 0, result=gain(6.6), data="same")
    add(tmp_path, 1, result=gain(6.7), data="same")
    add(tmp_path, 2, result=gain(6.6, doubts=["saturated"]))
    add(tmp_path, 3, status="aborted", result=gain(6.6))
    add(tmp_path, 4)
    add(tmp_path, 5, result={"gain_nm_per_v": None})
    found = trend(tmp_path)
    assert [point["value"] for point in found["groups"][0]["points"]] == [6.7]
    told = {row["run"][:4]: row["why"] for row in found["left_out"]}
    assert told.keys() == {"0000", "0002", "0003", "0004", "0005"}
    assert told["0000"] == "the same data as 0001-calibration-A"
    assert told["0002"] == "its data are doubtful"


def test_a_run_is_as_old_as_its_data(tmp_path):
    add(tmp_path, 100, result=gain(6.6))
    source = {"source": {"measured_utc": utc(7)}}
    add(tmp_path, 200, result=gain(6.7), details=source)
    add(tmp_path, 300, result=gain(6.8), details={"source": {"measured_utc": None}})
    points = trend(tmp_path)["groups"][0]["points"]
    assert [point["value"] for point in points] == [6.7, 6.6, 6.8]
    assert [point["time_known"] for point in points] == [True, True, False]


def test_a_diagnosis_is_as_old_as_the_run_that_it_looked_at(tmp_path, named_cause):
    add(tmp_path, 5, kind="ripple", result={"ripple": []})
    size = {"value": 2.0, "std": 0.1, "unit": "N m"}
    causes = [named_cause("coulomb-friction", {"coulomb_nm": size})]
    result = {"verdict": "named", "input_sha256": "x", "causes": causes}
    details = {"input": "elsewhere/0005-ripple-A"}
    add(tmp_path, 90, kind="diagnosis", result=result, details=details, files={})
    (group,) = trend(tmp_path, "friction")["groups"]
    assert group["series"] == "coulomb_nm"
    assert group["points"][0]["time_utc"] == "2025-01-06T00:00:00Z"


def test_runs_without_a_drive_are_grouped_by_their_profile(tmp_path):
    add(tmp_path, 0, drive="", result=gain(6.6))
    assert [group["name"] for group in trend(tmp_path)["groups"]] == ["profile p"]


def test_a_calibration_that_became_due_is_said_in_one_sentence(year):
    assert trend(year)["remarks"] == []
    said = trend(year, day=290 + 366)["remarks"]
    assert len(said) == 2
    assert said[0].startswith("The calibration of A became due on 2026-10-18: 0290-calibration-A")


def ripple(order, estimate, lines=()):
    body = {"value": 0.4, "std": 0.01, "dof": 7}
    size = {"amplitude_nm": body, "phase_rad": body}
    row = {"order": order, "order_estimate": {"value": estimate, "std": 1e-5}, **size}
    found = [{"order": x, "false_alarm_probability": 1e-6, **size} for x in lines]
    return {"ripple": [row], "lines": found}


@pytest.mark.parametrize(
    ("order", "estimate", "lines", "words"),
    [
        (2.0, 2.0005, (), None),
        (2.0, 2.02, (), "order 2 is now at 2.02"),
        (2.0, 2.0, (6.31,), "order 6.31 (0.4 N m) is in no block of it"),
        (3.0, 3.0, (), "order 3 (0.4 N m) is in no block of it"),
    ],
)
def test_a_filter_whose_orders_moved_is_said_in_one_sentence(
    tmp_path, order, estimate, lines, words
):
    model = {"name": "report-6", "blocks": [{"order": 2.0}, {"order": 4.0}]}
    add(tmp_path, 0, kind="ripple", result=ripple(order, estimate, lines), filter=model)
    said = trend(tmp_path, "ripple")["remarks"]
    assert len(said) == (words is not None)
    assert words is None or words in said[0]


def test_every_quantity_is_read_from_a_result_of_its_kind(tmp_path):
    calibration = {
        "gain_nm_per_v": NUMBER,
        "consistency": 0.02,
        "n_experiments": 9,
        "hysteresis": {"a": {**LOOP, "relative": -0.002}, "b": {**LOOP, "relative": 0.004}},
        "experiments": [{**LINE, "intercept_nm": 0.1}, {**LINE, "intercept_nm": 0.3}],
    }
    misalignment = {
        "amplitude_nm": NUMBER,
        "stretches": [STRETCH, STRETCH],
        "noise": {"order": 1, "coefficients": [], "innovation_std": 0.05, "n_samples": 200},
        "residual_rms_nm": 0.06,
        "n_samples": 200,
    }
    add(tmp_path, 0, result=calibration)
    add(tmp_path, 1, kind="misalignment", result=misalignment)
    more = {"noise_std_nm": 0.05, "residual_rms_nm": 0.05, "n_samples": 200}
    add(tmp_path, 2, kind="ripple", result={**ripple(2.0, 2.0), **more})
    found = {
        name: [
            (group["series"], round(point["value"], 9), round(point["std"], 9))
            for group in trend(tmp_path, name)["groups"]
            for point in group["points"]
        ]
        for name in QUANTITIES
        if name != "friction"
    }
    assert found == {
        "gain": [("", 0.9, 0.1)],
        "consistency": [("", 0.02, 0.005)],
        "hysteresis": [("", 0.003, 0.001)],
        "zero": [("at rest", 0.2, 0.1), ("in motion", 0.9, 0.070710678)],
        "misalignment": [("", 0.9, 0.1)],
        "ripple": [("order 2", 0.4, 0.01)],
        "noise": [("misalignment runs", 0.05, 0.0025), ("ripple runs", 0.05, 0.0025)],
        "residual": [("misalignment runs", 0.06, 0.003), ("ripple runs", 0.05, 0.0025)],
    }
    assert trend(tmp_path, "ripple", orders=(4.0,))["groups"] == []


def test_damaged_notes_are_an_error_with_their_line(tmp_path):
    folder = add(tmp_path, 0, result=gain(6.6))
    (folder / "notes.jsonl").write_text('{"utc": "x", "text": "y"}\nnonsense\n')
    with pytest.raises(DataError, match=r"notes\.jsonl:2"):
        trend(tmp_path)


@pytest.fixture
def hdbench(hdbench):
    """Return stdout alone."""
    return lambda *words, code=0: hdbench(*words, code=code)[0]


def test_the_command_writes_csv_json_and_a_page_and_checks(year, tmp_path, hdbench):
    # the names stand in options.toml as well, so that the help imports nothing of the library
    assert list(QUANTITIES) == declared("options")["trend"]["quantity"]["choices"]
    page, table = tmp_path / "out" / "trend.html", tmp_path / "points.csv"
    text = hdbench("trend", "gain", year, "--html", page, "--csv", table)
    assert "re-clamped <i>" in text
    hdbench("trend", "gain", year, "--html", page)  # over its own files
    hdbench("trend", "gain", year, "--check", code=3)
    hdbench("trend", "gain", year, "--check", "--drive", "A")
    body = json.loads(hdbench("trend", "gain", year, "--json"))
    assert body["schema"] == "hdbench/trend/1"
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert len(rows) == 60
    assert float(rows[0]["lower"]) < float(rows[0]["value"]) < float(rows[0]["upper"])
    html = page.read_text()
    assert "re-clamped &lt;i&gt;" in html
    assert "<i>" not in html
    assert "with probability 0.05 at one look" in html
    assert json.loads(page.with_suffix(".json").read_text())["groups"]


def test_wrong_calls_and_empty_folders(tmp_path, hdbench):
    assert "no run with torque gain" in hdbench("trend", "gain", tmp_path)
    hdbench("trend", "gain", tmp_path, "--html", tmp_path / "t.html")
    hdbench("trend", "gain", tmp_path / "none", code=4)
    hdbench("trend", "gain", tmp_path, "--order", "2", code=2)
    hdbench("trend", "speed", tmp_path, code=2)
