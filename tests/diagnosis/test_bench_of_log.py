"""A profile out of a trace: what is filled, what is asked for, what such a bench supports."""

import json

import numpy as np
import pytest

from hdbench.diagnosis.bench import Known, bench_of_trace
from hdbench.errors import DataError, ProfileError
from hdbench.profile import load_profile, parse_profile
from hdbench.records import Trace, write_trace
from hdbench_cli.main import main


def log(**changes):
    """A direct drive that swings over some turns, at 250 Hz."""
    rng = np.random.default_rng(4)
    time = np.arange(5000) / 250.0
    velocity = 30.0 * np.cos(2 * np.pi * 0.4 * time) + 9.0 * np.cos(2 * np.pi * 1.3 * time)
    angle = np.cumsum(velocity) / 250.0
    count = 2 * np.pi / 8192
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": velocity + 0.05 * rng.standard_normal(5000),
        "motor_angle_rad": np.floor(angle / count) * count,
        "torque_nm": 0.4 * np.tanh(velocity) + 0.02 * rng.standard_normal(5000),
        **changes,
    }
    return Trace({name: values for name, values in columns.items() if values is not None})


def made(trace, known):
    bench = bench_of_trace(trace, "direct", known)
    return bench, parse_profile(bench.text, "direct.toml").data


def test_limits_rate_steps_and_noise_are_those_of_the_log():
    trace = log()
    _, data = made(trace, Known(1.0, 0.002))
    assert data.drive.gear_ratio == 1.0
    assert data.drive.load_inertia_kg_m2 == 0.002
    assert data.daq.sample_period_s == pytest.approx(0.004)
    assert data.encoder.counts_per_turn == 8192
    # a median of 100 bins is good to a tenth
    assert data.sensor.noise_nm == pytest.approx(0.02, rel=0.15)
    reached = np.abs(trace["motor_velocity_rad_s"]).max()
    assert data.limits.velocity_rad_s == pytest.approx(reached, rel=0.02)
    assert data.limits.torque_nm == pytest.approx(np.abs(trace["torque_nm"]).max(), rel=0.1)


@pytest.mark.parametrize(
    ("ratio", "orders", "expected"),
    [(1.0, (), (1.0,)), (9.0, (), (1.0,)), (100.0, (), None), (1.0, (6.0, 12.0), (6.0, 12.0))],
)
def test_orders_follow_the_kind_of_drive(ratio, orders, expected):
    assert made(log(), Known(ratio, 0.01, None, orders))[1].model.baseline_orders == expected


def test_it_says_which_experiments_and_causes_the_log_supports():
    bench, _ = made(log(), Known(100.0, 0.01))
    experiments = {one.name: one for one in bench.experiments}
    assert experiments["run-ripple"].supported
    assert "output turns" in experiments["run-misalignment"].because
    causes = {one.name: one for one in bench.causes}
    assert causes["coulomb-friction"].supported
    assert "motor_current_a" in causes["crosstalk"].because


def test_a_filtered_torque_tells_no_noise():
    from scipy.signal import butter, sosfiltfilt

    smooth = sosfiltfilt(butter(4, 5.0, fs=250.0, output="sos"), log()["torque_nm"])
    _, data = made(log(torque_nm=smooth), Known(1.0, 0.002))
    assert data.sensor.noise_nm == load_profile("cim-tr-97-06").data.sensor.noise_nm


@pytest.mark.parametrize("known", [Known(0.5, 0.01), Known(100.0, -1.0)])
def test_values_outside_of_their_domain_are_refused(known):
    with pytest.raises(ProfileError):
        made(log(), known)


def test_a_log_without_motion_is_refused():
    still = np.zeros(5000)
    with pytest.raises(DataError, match="motion"):
        made(log(motor_velocity_rad_s=still, motor_angle_rad=still), Known(1.0, 0.01))


def called(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main(["profile", "new", "direct", *map(str, words), "--json"])
    return ended.value.code, json.loads(capsys.readouterr().out)


def test_the_command_asks_for_what_no_log_tells(tmp_path, capsys):
    trace = tmp_path / "trace.csv"
    write_trace(trace, log())
    code, body = called(capsys, "--from", trace, "--load-inertia", 0.01)
    assert code == 2
    assert "--gear-ratio" in body["error"]["fix"]
    code, body = called(capsys, "--from", trace, "--load-inertia", 0.01, "--gear-ratio", 1)
    assert code == 0
    assert {one["key"] for one in body["filled"]} >= {"limits.torque_nm", "daq.sample_period_s"}
    assert called(capsys, "--gear-ratio", 1)[0] == 2
