"""`hdbench filter` from the command line's point of view."""

import csv
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from hdbench.filter import load_filter_model
from hdbench.profile import load_profile
from hdbench.records import RunFolder
from hdbench_cli.commands.filter import command
from hdbench_cli.output import Output

HEADER = "time_s,torque_nm,torque_expected_nm,ripple_nm,misalignment_nm,torque_filtered_nm"


def write(path: Path, names: str, *columns: np.ndarray) -> Path:
    rows = zip(*(column.tolist() for column in columns), strict=True)
    text = "\n".join(",".join(map(repr, row)) for row in rows)
    path.write_text(f"{names}\n{text}\n")
    return path


@pytest.fixture
def volts(tmp_path: Path) -> Path:
    t = np.arange(400) * 1e-3
    v = 60.0 + 20.0 * np.sin(9.0 * t)
    angle = np.concatenate([[0.0], np.cumsum(v[:-1] * 1e-3)])
    y = 0.1 + 0.05 * np.cos(2.0 * angle)
    return write(tmp_path / "volts.csv", "time_s,tacho_v,torque_v", t, v / 56.2565, y)


def run(*arguments: object, as_json: bool = True) -> Result:
    return CliRunner().invoke(
        command, [str(argument) for argument in arguments], obj=Output(json=as_json)
    )


def read(path: Path) -> dict[str, np.ndarray]:
    rows = list(csv.DictReader(path.read_text().splitlines()))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def test_it_writes_the_contracts_columns_with_all_digits(volts, tmp_path):
    out = tmp_path / "clean.csv"
    found = run(volts, "--model", "report-a1", "--out", out)
    assert found.exit_code == 0, found.output
    assert out.read_text().splitlines()[0] == HEADER
    table = read(out)
    np.testing.assert_array_equal(
        table["torque_nm"] - (table["ripple_nm"] + table["misalignment_nm"]),
        table["torque_filtered_nm"],
    )
    body = json.loads(found.stdout)
    assert body["schema"] == "hdbench/filter/1"
    assert body["filter"]["name"] == "report-a1"


def test_the_result_says_which_gain_scaled_the_volts(volts, tmp_path):
    out = tmp_path / "clean.csv"
    raw = read(volts)["torque_v"]
    by_profile = json.loads(run(volts, "--out", out).stdout)
    assert "profile cim-tr-97-06" in by_profile["torque_scale"]["source"]
    np.testing.assert_array_equal(read(out)["torque_nm"], raw * 6.6)
    by_option = json.loads(run(volts, "--out", out, "--gain", "3.5").stdout)
    assert "--gain" in by_option["torque_scale"]["source"]
    np.testing.assert_array_equal(read(out)["torque_nm"], raw * 3.5)


def test_a_fed_models_gain_serves_where_none_is_named(volts, tmp_path):
    out, file = tmp_path / "clean.csv", tmp_path / "own.json"
    body = json.loads(run(volts, "--out", out).stdout)["filter"]
    body["torque_gain_nm_per_v"] = 7.0
    body["provenance"]["torque_gain_nm_per_v"] = "calibration run 12"
    file.write_text(json.dumps(body))
    found = json.loads(run(volts, "--model", file, "--out", out).stdout)
    assert "calibration run 12" in found["torque_scale"]["source"]
    np.testing.assert_array_equal(read(out)["torque_nm"], read(volts)["torque_v"] * 7.0)


def test_lost_samples_are_written_as_nan_and_exit_6(tmp_path):
    t = np.arange(300) * 1e-3
    y = np.cos(t)
    y[100:103] = math.nan
    source = write(
        tmp_path / "trace.csv", "time_s,motor_velocity_rad_s,torque_nm", t, 0 * t + 50.0, y
    )
    out = tmp_path / "clean.csv"
    found = run(source, "--out", out)
    assert found.exit_code == 6
    assert json.loads(found.stdout)["missing_samples"] == 3
    np.testing.assert_array_equal(np.isnan(read(out)["torque_filtered_nm"]), np.isnan(y))


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--model", "tuned"], 4),
        (["--model", "nowhere.json"], 4),
        (["--gain", "nan"], 2),
        (["--gain", "0"], 2),
    ],
)
def test_bad_options_end_with_the_contracts_code(volts, tmp_path, arguments, code):
    out = tmp_path / "clean.csv"
    found = run(volts, "--out", out, *arguments)
    assert getattr(found.exception, "exit_code", found.exit_code) == code
    assert not out.exists()


def test_it_needs_an_output_file_and_refuses_two_gains(volts, tmp_path):
    assert run(volts).exit_code == 2
    both = run(volts, "--out", tmp_path / "a.csv", "--gain", "1", "--calibration", volts)
    assert both.exit_code == 2


def test_people_read_model_gain_and_place(volts, tmp_path):
    out = tmp_path / "clean.csv"
    found = run(volts, "--out", out, as_json=False)
    assert found.exit_code == 0
    for word in ("report-6", "orders 2, 4, 0.01", "N m", os.fspath(out)):
        assert word in found.stdout


def test_a_run_is_filtered_by_the_filter_that_ran_in_it(volts, tmp_path):
    profile = load_profile("cim-tr-97-06")
    ran = load_filter_model("report-a1", profile.data)
    folder = RunFolder.create(tmp_path / "runs", kind="ripple", profile=profile, details={})
    folder.update(filter=ran.to_dict())
    folder.trace.write_bytes(volts.read_bytes())
    out = tmp_path / "clean.csv"
    found = json.loads(run(folder.path, "--out", out).stdout)
    assert found["filter"]["name"] == "report-a1"
    named = json.loads(run(folder.path, "--model", "report-6", "--out", out).stdout)
    assert named["filter"]["name"] == "report-6"
    other = tmp_path / "other.toml"
    other.write_text(profile.text.replace("gear_ratio = 100.0", "gear_ratio = 50.0"))
    changed = json.loads(run(folder.path, "--profile", other, "--out", out).stdout)
    assert changed["filter"]["gear_ratio"] == 50.0


def test_it_never_writes_over_what_was_measured(volts, tmp_path):
    before = volts.read_bytes()
    link = tmp_path / "link.csv"
    link.symlink_to(volts)
    for out in (volts, link):
        assert getattr(run(volts, "--out", out).exception, "exit_code", None) == 2
    assert volts.read_bytes() == before


@pytest.mark.parametrize("fault", ["rows-missing", "beyond-any-motor", "end-of-the-converter"])
def test_gaps_faults_and_saturation_exit_6_and_are_marked(tmp_path, fault):
    t = np.arange(300) * 1e-3
    v, y = 0 * t + 50.0, np.cos(t)
    name = "torque_v" if fault == "end-of-the-converter" else "torque_nm"
    if fault == "rows-missing":
        t, v, y = (np.delete(column, slice(100, 140)) for column in (t, v, y))
    elif fault == "beyond-any-motor":
        v[100] = 1e300
    else:
        y[100:110] = 10.0
    source = write(tmp_path / "trace.csv", f"time_s,motor_velocity_rad_s,{name}", t, v, y)
    found = run(source, "--out", tmp_path / "clean.csv")
    assert found.exit_code == 6
    flag = {"rows-missing": "gap", "beyond-any-motor": "missing-samples"}.get(fault, "saturation")
    assert [entry["name"] for entry in json.loads(found.stdout)["flags"]] == [flag]
