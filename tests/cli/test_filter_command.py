"""`hdbench filter` from the command line's point of view."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from hdbench.filter import load_filter_model
from hdbench.profile import load_profile
from hdbench.records import RunFolder

HEADER = "time_s,torque_nm,torque_expected_nm,ripple_nm,misalignment_nm,torque_filtered_nm"


def write(path: Path, names: str, *columns: np.ndarray) -> Path:
    np.savetxt(path, np.stack(columns, 1), "%.17g", ",", header=names, comments="")
    return path


@pytest.fixture
def volts(tmp_path: Path) -> Path:
    t = np.arange(400) * 1e-3
    v = 60.0 + 20.0 * np.sin(9.0 * t)
    angle = np.concatenate([[0.0], np.cumsum(v[:-1] * 1e-3)])
    y = 0.1 + 0.05 * np.cos(2.0 * angle)
    return write(tmp_path / "volts.csv", "time_s,tacho_v,torque_v", t, v / 56.2565, y)


@pytest.fixture
def filtered(answer):
    return lambda *words, code=0: answer("filter", *words, code=code)


def read(path: Path) -> np.ndarray:
    return np.genfromtxt(path, delimiter=",", names=True)


def test_it_writes_the_contracts_columns_with_all_digits(volts, tmp_path, filtered):
    out = tmp_path / "clean.csv"
    body = filtered(volts, "--model", "report-a1", "--out", out)
    assert out.read_text().splitlines()[0] == HEADER
    table = read(out)
    np.testing.assert_array_equal(
        table["torque_nm"] - (table["ripple_nm"] + table["misalignment_nm"]),
        table["torque_filtered_nm"],
    )
    assert body["schema"] == "hdbench/filter/1"
    assert body["filter"]["name"] == "report-a1"


def test_the_result_says_which_gain_scaled_the_volts(volts, tmp_path, filtered):
    out = tmp_path / "clean.csv"
    raw = read(volts)["torque_v"]
    by_profile = filtered(volts, "--out", out)
    assert "profile cim-tr-97-06" in by_profile["torque_scale"]["source"]
    np.testing.assert_array_equal(read(out)["torque_nm"], raw * 6.6)
    by_option = filtered(volts, "--out", out, "--gain", "3.5")
    assert "--gain" in by_option["torque_scale"]["source"]
    np.testing.assert_array_equal(read(out)["torque_nm"], raw * 3.5)


def test_a_fed_models_gain_serves_where_none_is_named(volts, tmp_path, filtered):
    out, file = tmp_path / "clean.csv", tmp_path / "own.json"
    body = filtered(volts, "--out", out)["filter"]
    body["torque_gain_nm_per_v"] = 7.0
    body["provenance"]["torque_gain_nm_per_v"] = "calibration run 12"
    file.write_text(json.dumps(body))
    found = filtered(volts, "--model", file, "--out", out)
    assert "calibration run 12" in found["torque_scale"]["source"]
    np.testing.assert_array_equal(read(out)["torque_nm"], read(volts)["torque_v"] * 7.0)


def test_lost_samples_are_written_as_nan_and_exit_6(tmp_path, filtered):
    t = np.arange(300) * 1e-3
    y = np.cos(t)
    y[100:103] = math.nan
    source = write(
        tmp_path / "trace.csv", "time_s,motor_velocity_rad_s,torque_nm", t, 0 * t + 50.0, y
    )
    out = tmp_path / "clean.csv"
    assert filtered(source, "--out", out, code=6)["missing_samples"] == 3
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
def test_bad_options_end_with_the_contracts_code(volts, tmp_path, arguments, code, filtered):
    out = tmp_path / "clean.csv"
    filtered(volts, "--out", out, *arguments, code=code)
    assert not out.exists()


def test_it_needs_an_output_file_and_refuses_two_gains(volts, tmp_path, filtered):
    filtered(volts, code=2)
    filtered(volts, "--out", tmp_path / "a.csv", "--gain", "1", "--calibration", volts, code=2)


def test_people_read_model_gain_and_place(volts, tmp_path, hdbench):
    out = tmp_path / "clean.csv"
    shown, _ = hdbench("filter", volts, "--out", out)
    for word in ("report-6", "orders 2, 4, 0.01", "N m", str(out)):
        assert word in shown


def test_a_run_is_filtered_by_the_filter_that_ran_in_it(volts, tmp_path, filtered):
    profile = load_profile("cim-tr-97-06")
    folder = RunFolder.create(tmp_path / "runs", kind="ripple", profile=profile, details={})
    folder.update(filter=load_filter_model("report-a1", profile.data).to_dict())
    folder.trace.write_bytes(volts.read_bytes())
    words = (folder.path, "--out", tmp_path / "clean.csv")
    assert filtered(*words)["filter"]["name"] == "report-a1"
    assert filtered(*words, "--model", "report-6")["filter"]["name"] == "report-6"
    other = tmp_path / "other.toml"
    other.write_text(profile.text.replace("gear_ratio = 100.0", "gear_ratio = 50.0"))
    assert filtered(*words, "--profile", other)["filter"]["gear_ratio"] == 50.0


def test_it_never_writes_over_what_was_measured(volts, tmp_path, filtered):
    before = volts.read_bytes()
    link = tmp_path / "link.csv"
    link.symlink_to(volts)
    for out in (volts, link):
        filtered(volts, "--out", out, code=2)
    assert volts.read_bytes() == before


@pytest.mark.parametrize("flag", ["gap", "missing-samples", "saturation"])
def test_gaps_faults_and_saturation_exit_6_and_are_marked(tmp_path, flag, filtered):
    t = np.arange(300) * 1e-3
    v, y, torque = 0 * t + 50.0, np.cos(t), "torque_nm"
    if flag == "gap":
        t, v, y = (np.delete(column, slice(100, 140)) for column in (t, v, y))
    elif flag == "missing-samples":
        v[100] = 1e300
    else:
        y[100:110], torque = 10.0, "torque_v"
    source = write(tmp_path / "trace.csv", f"time_s,motor_velocity_rad_s,{torque}", t, v, y)
    found = filtered(source, "--out", tmp_path / "clean.csv", code=6)
    assert [entry["name"] for entry in found["flags"]] == [flag]
