"""Maps of the residual show where it sits; the filter gains by the orders that were found."""

import json

import numpy as np
import pytest
from swinging_shaft import record

from hdbench.diagnosis import diagnose_run
from hdbench.diagnosis.answer.result import Pictures
from hdbench.diagnosis.answer.tables import code_map, residual_maps
from hdbench.profile import load_profile
from hdbench.records import write_trace

PROFILE = load_profile("cim-tr-97-06")


def pictures(before, after, speed):
    time, nothing = np.arange(len(speed)) * 1e-3, np.zeros(len(speed))
    angle = np.cumsum(speed) * 1e-3
    return Pictures(
        time, speed, nothing, nothing, nothing, before, after, nothing > 0.0, (),
        np.gradient(speed, 1e-3), angle, angle / 100.0, nothing,
    )  # fmt: skip


def sweep(n):
    return 100.0 * np.sin(2.0 * np.pi * np.arange(n) / n * 3.0)


def test_the_mean_residual_over_speed_is_the_curve_that_was_put_in():
    speed = sweep(60_000)
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(speed))
    maps = residual_maps(pictures(2e-3 * speed + noise, noise, speed))
    found = maps["velocity"]
    away = (found["before_nm"] - 2e-3 * found["motor_velocity_rad_s"]) / found["before_std_nm"]
    # 48 means of a normal law: the largest of 48 lies above 4 with a probability of 3e-3
    assert np.abs(away).max() < 4.0
    assert found["samples"].sum() == len(speed)
    assert "torque" not in maps  # the load is zero throughout


def test_noise_that_grows_with_speed_shows_in_the_variance_map():
    speed = sweep(60_000)
    noise = (0.01 + 1e-3 * np.abs(speed)) * np.random.default_rng(2).standard_normal(len(speed))
    found = residual_maps(pictures(noise, noise, speed))["variance"]
    expected = 0.01 + 1e-3 * found["absolute_velocity_rad_s"]
    # bins of 1000 samples know their rms to 2.2 %; the bin's own width adds to the first ones
    assert np.abs(found["after_nm"][3:] / expected[3:] - 1.0).max() < 0.1


def test_masked_and_lost_samples_enter_no_map():
    before = np.full(6_000, 1.0)
    before[:100] = np.nan
    made = pictures(before, before, sweep(6_000))
    made.masked[100:200] = True
    for found in residual_maps(made).values():
        assert found["samples"].sum() <= 5_800
        np.testing.assert_allclose(found["before_nm"], 1.0)


def test_a_stuck_bit_empties_half_of_the_codes():
    codes = np.arange(4096) | 2
    table = code_map(codes * 1e-3, 1e-3)
    assert (table["samples"] == 0.0).sum() == 16
    assert table["share"].sum() == pytest.approx(1.0)


def test_an_order_that_was_found_is_taken_out_by_the_filter(tmp_path):
    trace = record(
        motion=(100.0, 30.0, 7.0), ripple=((2.0, 0.4, 0.0), (7.0, 0.3, 0.4)), n=6000, seed=5
    )
    write_trace(tmp_path / "trace.csv", trace)
    folder, result = diagnose_run(tmp_path / "trace.csv", PROFILE, out=tmp_path / "runs")
    (block,) = result.filter_gain.blocks
    assert block.order == pytest.approx(7.0, abs=1e-3)
    sizes = block.amplitude_nm
    # the report's own tuning passes part of a further order and takes it with its own block
    assert sizes.after < 0.05 * sizes.before
    assert json.loads((folder / "result.json").read_text()) == result.to_json()
    names = {path.name for path in folder.iterdir()}
    assert {"map_velocity.csv", "map_acceleration.csv", "map_motor_angle.csv"} <= names
