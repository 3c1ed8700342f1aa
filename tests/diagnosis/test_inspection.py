"""Inspection of logs with a fault, and of logs without one."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from hdbench.diagnosis.inspection import inspect_log, inspect_trace, read_log
from hdbench.diagnosis.inspection.result import Inspection
from hdbench.errors import DataError
from hdbench.model import BenchModel, simulate_run
from hdbench.profile import load_profile
from hdbench.records import Trace, write_trace

PROFILE = load_profile("cim-tr-97-06").data
RATE = 500.0
REAL = Path(os.environ.get("HDBENCH_DATA", "/nowhere")) / "real"
needs_data = pytest.mark.skipif(not REAL.is_dir(), reason="HDBENCH_DATA is not set")


def clean(rate=RATE, seconds=30.0, noise=0.05, step=0.01, seed=1):
    """A drive that swings at several speeds: encoder, noisy tacho, torque of a converter."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate)) / rate
    phases = ((40.0, 0.3, 0.0), (25.0, 0.71, 1.0), (8.0, 2.3, 2.0))
    velocity = sum(a * np.cos(2 * np.pi * f * time + p) for a, f, p in phases)
    angle = sum(a / (2 * np.pi * f) * np.sin(2 * np.pi * f * time + p) for a, f, p in phases)
    torque = 0.02 * velocity + 2.0 * np.tanh(velocity) + 0.3 * np.cos(2 * angle)
    count = 2 * np.pi / 10000
    return {
        "time_s": time,
        "motor_velocity_rad_s": velocity + 0.06 * rng.standard_normal(len(time)),
        "motor_angle_rad": np.floor(angle / count) * count,
        "torque_nm": step * np.round((torque + noise * rng.standard_normal(len(time))) / step),
    }


def inspected(columns) -> Inspection:
    return inspect_trace(Trace(columns), PROFILE)


def named(result):
    return {(one.name, one.channel) for one in result.findings}


def found(columns):
    return named(inspected(columns))


def channels(result):
    return {one.name: one for one in result.channels}


def written(folder, *rows):
    """Return what is inspected of a file of these rows."""
    path = folder / "log.csv"
    path.write_text("\n".join(rows) + "\n")
    return inspect_log(read_log(path), PROFILE)


@pytest.mark.parametrize("rate", [50.0, 125.0, 1000.0])
@pytest.mark.parametrize("noise", [0.003, 0.05, 0.5])
def test_nothing_is_found_in_a_clean_log(rate, noise):
    assert found(clean(rate, noise=noise, step=0.01 if noise > 0.004 else 0.005)) == set()


def test_facts_of_a_clean_log():
    seen = channels(inspected(clean()))
    torque = seen["torque_nm"]
    assert torque.resolution == pytest.approx(0.01, rel=1e-6)
    # noise of 0.05 and rounding of 0.01 / sqrt(12); a median of 100 bins is good to a tenth
    assert torque.noise == pytest.approx(0.05, rel=0.15)
    assert torque.bandwidth_hz == pytest.approx(RATE / 2)
    assert torque.held_share == torque.missing_share == 0.0
    assert seen["motor_angle_rad"].resolution == pytest.approx(2 * np.pi / 10000, rel=1e-6)


def filtered(values, hertz, order=2):
    from scipy.signal import butter, sosfiltfilt

    return sosfiltfilt(butter(order, hertz, fs=RATE, output="sos"), values)


@pytest.mark.parametrize("hertz", [10.0, 30.0])
def test_a_low_passed_torque_is_found_with_its_band(hertz):
    columns = clean(step=1e-9)
    columns["torque_nm"] = filtered(columns["torque_nm"], hertz)
    result = inspected(columns)
    assert ("low-passed", "torque_nm") in named(result)
    assert hertz < channels(result)["torque_nm"].bandwidth_hz < 12 * hertz


@pytest.mark.parametrize("noise_nm", [0.0, 0.05])
def test_a_simulated_torque_is_computed_where_it_has_no_noise(noise_nm):
    model, wave = BenchModel.from_profile(PROFILE), PROFILE.ripple.reference
    trace = simulate_run(
        PROFILE, model, duration_s=8.0, wave=wave, noise_nm=noise_nm, rng=np.random.default_rng(0)
    )
    names = {one.channel: one.name for one in inspect_trace(trace, PROFILE).findings}
    assert names["torque_true_nm"] == "computed"
    assert names.get("torque_nm") == ("computed" if noise_nm == 0.0 else None)


def smoothed_rate(columns):
    rate = np.gradient(columns["motor_angle_rad"]) * RATE
    return {"motor_velocity_rad_s": filtered(rate, 60.0)}


def stuck(columns):
    torque = columns["torque_nm"].copy()
    torque[3000:3500] = torque[3000]
    return {"torque_nm": torque}


@pytest.mark.parametrize(
    ("change", "finding"),
    [
        (smoothed_rate, ("derived", "motor_velocity_rad_s")),
        (lambda c: {"motor_current_a": c["torque_nm"] / 2.5}, ("derived", "torque_nm")),
        (lambda c: {"torque_nm": np.clip(c["torque_nm"], -2.0, 2.0)}, ("saturation", "torque_nm")),
        (stuck, ("stuck-value", "torque_nm")),
        (lambda c: clean(noise=0.02, step=0.5), ("coarse-steps", "torque_nm")),
    ],
)
def test_what_was_done_to_a_channel_is_found(change, finding):
    columns = clean()
    assert finding in found(columns | change(columns))


@pytest.mark.parametrize("samples", [4, 12])
def test_a_late_velocity_is_found_with_its_delay(samples):
    columns = clean()
    columns["motor_velocity_rad_s"] = np.roll(columns["motor_velocity_rad_s"], samples)
    result = inspected(columns)
    assert ("delay", "motor_velocity_rad_s") in named(result)
    velocity = result.channels[0]
    assert abs(velocity.delay_s - samples / RATE) < 4.0 * velocity.delay_std_s + 0.05 / RATE


def test_held_samples_are_found_and_counted():
    columns = clean(step=1e-4)
    rng = np.random.default_rng(5)
    fresh = rng.random(len(columns["time_s"])) > 0.04
    last = np.maximum.accumulate(np.where(fresh, np.arange(len(fresh)), 0))
    columns["torque_nm"] = columns["torque_nm"][last]
    seen = channels(inspected(columns))
    assert seen["torque_nm"].held_share == pytest.approx(0.04, abs=0.01)
    assert seen["motor_velocity_rad_s"].held_share == 0.0


def test_stamps_that_jitter_and_gaps_are_found():
    columns = clean()
    rng = np.random.default_rng(2)
    jittered = columns | {"time_s": columns["time_s"] + rng.uniform(-0.2, 0.2, 15000) / RATE}
    result = inspected(jittered)
    assert [one.name for one in result.findings] == ["uneven-stamps"]
    assert result.sampling.even_beneath
    kept = np.ones(15000, dtype=bool)
    kept[5000:5020] = False
    result = inspected({name: values[kept] for name, values in columns.items()})
    assert [gap.samples for gap in result.sampling.gaps] == [20]
    assert [one.name for one in result.findings] == ["gaps"]


def test_a_constant_speed_limits_what_the_motion_tells_and_is_no_fault():
    columns = clean()
    rng = np.random.default_rng(3)
    columns["motor_velocity_rad_s"] = 50.0 + 0.06 * rng.standard_normal(15000)
    columns["motor_angle_rad"] = np.floor(columns["time_s"] * 50.0 / 1e-3) * 1e-3
    result = inspected(columns)
    assert result.findings == ()
    assert {one.name for one in result.coverage.limits} == {"one-speed", "no-reversal"}


def test_a_log_without_a_time_is_told_and_not_refused(tmp_path):
    result = written(tmp_path, "angle,torque", *(f"{0.1 * k},{k % 7}" for k in range(50)))
    assert [one.name for one in result.findings if one.channel is None] == ["no-time"]


def test_repeated_stamps_are_told(tmp_path):
    rows = (f"{0.01 * (k - (k == 30))},{np.sin(k)}" for k in range(100))
    result = written(tmp_path, "time_s,torque_nm", *rows)
    assert result.sampling.repeated == 1
    assert "repeated-stamps" in {one.name for one in result.findings}


def test_a_file_without_numbers_is_refused(tmp_path):
    with pytest.raises(DataError):
        written(tmp_path, "a,b", "x,y")


def test_the_command_prints_one_object(tmp_path, hdbench):
    path = tmp_path / "trace.csv"
    write_trace(path, Trace(clean(125.0, 10.0)))
    body = json.loads(hdbench("inspect", path, "--json")[0])
    assert body["schema"] == "hdbench/inspect/1"
    assert {"name", "unit", "rate_hz", "bandwidth_hz", "resolution", "missing_share", "held_share",
            "derived_from", "delay_s"} <= set(body["channels"][0])  # fmt: skip
    assert body["sampling"]["median_s"] == pytest.approx(0.008)
    assert body["findings"] == []


@needs_data
@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("ur10_shoulder_pan_joint.csv.gz", ("low-passed", "torque_nm")),
        ("ur10_wrist_2_joint.csv.gz", ("low-passed", "torque_nm")),
        ("ur10_wrist_3_joint.csv.gz", ("low-passed", "torque_nm")),
        ("emps.csv.gz", ("derived", "motor_velocity_rad_s")),
        ("emps_pulses.csv.gz", ("derived", "motor_velocity_rad_s")),
        ("cogging_1.csv.gz", ("uneven-stamps", None)),
        ("cogging_2.csv.gz", ("uneven-stamps", None)),
        ("raw/cogging_1.txt", ("uneven-stamps", None)),
        ("raw/kuka_med.csv", ("no-time", None)),
        ("raw/xl330_pendulum.json", ("stuck-value", "entries/load")),
        ("raw/xl330_pendulum.json", ("no-scale", "entries/load")),
    ],
)
def test_what_is_known_of_real_logs_is_found(file, expected):
    result = inspect_log(read_log(REAL / file), PROFILE)
    assert expected in named(result)
