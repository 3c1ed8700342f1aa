"""The page of a fleet: false alarms, outliers, causes, links, size."""

import json
from pathlib import Path

import numpy as np
import pytest
from runkit import misalignment_result, write_run

from hdbench.errors import DataError
from hdbench.report.fleet import FALSE_ALARM, fleet_runs, outlier_limit, write_fleet


def run_of(folder: Path, drive: str, kind: str, result: dict) -> Path:
    write_run(folder, kind, result, drive=drive, started_utc="2026-11-23T07:00:00Z")
    (folder / "report.html").write_text("its own report")
    return folder


@pytest.mark.parametrize("count", [8, 30, 300])
def test_a_fleet_without_outliers_names_one_as_often_as_stated(count):
    # own draws; 4000 fleets at 5 %: a standard deviation of 0.34 %, here 4 of them
    rng = np.random.default_rng(99)
    drawn = rng.standard_normal((4000, count))
    away = np.abs(drawn - np.median(drawn, axis=1, keepdims=True))
    scatter = 1.4826 * np.median(away, axis=1)
    named = np.mean(away.max(axis=1) > outlier_limit(count, FALSE_ALARM) * scatter)
    assert abs(named - FALSE_ALARM) < 0.014


@pytest.mark.parametrize("std", [0.001, 0.2])
def test_an_outlier_is_named_unless_it_is_uncertain_and_leads_to_its_report(tmp_path, std):
    rng = np.random.default_rng(1)
    for number in range(40):
        amplitude = 0.9 + 0.03 * rng.standard_normal() + (0.4 if number == 7 else 0.0)
        result = misalignment_result(amplitude, std if number == 7 else 0.001)
        run_of(tmp_path / "runs" / f"r {number}", f"HD-{number:02d} <b>", "misalignment", result)
    files = write_fleet(fleet_runs([tmp_path / "runs"]), tmp_path / "page")
    body = json.loads(files.json.read_text())["kinds"]["misalignment"]
    told = {figure["figure"]: figure["outliers"] for figure in body["figures"]}
    assert told["amplitude_nm"] == (["HD-07 <b>"] if std < 0.1 else [])
    assert not any("phase" in name or "turns" in name for name in told)
    page = files.html.read_text()
    assert "../runs/r%207/report.html" in page
    assert "HD-07 &lt;b&gt;" in page
    assert "<b>" not in page.split("Drives")[-1]
    assert len(files.csv.read_text().splitlines()) == 1 + 5 * 40


def test_causes_by_frequency_and_three_kilobytes_for_a_drive(tmp_path, named_cause):
    for number in range(200):
        size = {"value": 0.5 + 0.0005 * number, "std": 0.01, "unit": "N m"}
        cause = named_cause("coulomb-friction", {"coulomb_nm": size})
        causes = [cause] if number % 4 == 0 else []
        result = {"verdict": "named" if causes else "nothing-found", "causes": causes,
                  "simulated": {"heldout_rms_nm": 0.1 + 5e-5 * number}}  # fmt: skip
        run_of(tmp_path / "runs" / f"r{number}", f"HD-{number}", "diagnosis", result)
    files = write_fleet(fleet_runs([tmp_path / "runs"]), tmp_path / "fleet.html")
    page = files.html.read_text()
    assert files.html.stat().st_size < 200 * 3e3
    assert page.count("report.html") >= 200
    # 50 of 200, interval of Clopper and Pearson
    assert "<td>coulomb-friction</td><td>50</td><td>25.0% (19.2% to 31.6%)</td>" in page


def test_results_of_a_kind_without_a_type_are_shown_too(tmp_path):
    for number in range(3):
        run_of(tmp_path / f"r{number}", f"d{number}", "inspection", {"rest": {"rms_nm": 0.1}})
    body = json.loads(write_fleet(fleet_runs([tmp_path]), tmp_path).json.read_text())
    assert list(body["kinds"]) == ["inspection"]


def test_few_drives_are_shown_and_not_judged_and_none_is_an_error(tmp_path):
    run_of(tmp_path / "runs" / "a", "HD-1", "misalignment", misalignment_result(0.9))
    page = write_fleet(fleet_runs([tmp_path / "runs" / "a"]), tmp_path).html.read_text()
    assert "No drive is judged" in page
    with pytest.raises(DataError, match="no batch and no run"):
        fleet_runs([tmp_path / "nothing"])
