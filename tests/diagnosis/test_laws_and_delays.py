"""Delays of the whole signal, laws that no entry has, spikes beside causes, short records."""

import os
from pathlib import Path

import numpy as np
import pytest

from hdbench.diagnosis import diagnose_loads, diagnose_trace
from hdbench.diagnosis.confirm.predicted import held_out_residuals
from hdbench.diagnosis.detect.transform import plan_transform
from hdbench.diagnosis.fit.jointfit import fit_jointly
from hdbench.diagnosis.measured.record import prepare_record
from hdbench.diagnosis.measured.skewed import signal_in_channel
from hdbench.diagnosis.noise.whitened import Whitener
from hdbench.model import BenchModel
from hdbench.profile import load_profile
from hdbench.records import LoadReading, Loads, Trace

PROFILE = load_profile("cim-tr-97-06")
NOISE_NM = 0.02


def shaft(n=14_000):
    """Time, angle, speed and acceleration of a motor whose speed swings through zero."""
    time = np.arange(n) * 1e-3
    rate = 2.0 * np.pi / 5.0
    speed = 30.0 + 60.0 * np.sin(rate * time)
    angle = 30.0 * time + 60.0 / rate * (1.0 - np.cos(rate * time))
    return time, angle, speed, 60.0 * rate * np.cos(rate * time)


def torque_at(angle, accel):
    """Ripple of both lobes and the load's inertia."""
    return 0.4 * np.cos(2.0 * angle) + 0.2 * np.sin(4.0 * angle) + 1.725e-4 * accel


def trace_of(torque, n=14_000, seed=4):
    time, angle, speed, _ = shaft(n)
    noise = NOISE_NM * np.random.default_rng(seed).standard_normal(n)
    columns = {"time_s": time, "motor_angle_rad": angle, "motor_velocity_rad_s": speed}
    return Trace({**columns, "torque_nm": torque + noise})


def record_of(trace):
    masked = np.zeros(len(trace), dtype=bool)
    return prepare_record(trace, PROFILE.data, BenchModel.from_profile(PROFILE.data), masked)


def white_fit(record, terms=()):
    white = Whitener(np.ones(1), NOISE_NM, record.valid, record.valid)
    return fit_jointly(record, terms, white, refine=False), white


def late_torque(delay):
    """The torque of the same motion, computed at an earlier time."""
    time = np.arange(14_000) * 1e-3 - delay
    rate = 2.0 * np.pi / 5.0
    angle = 30.0 * time + 60.0 / rate * (1.0 - np.cos(rate * time))
    return torque_at(angle, 60.0 * rate * np.cos(rate * time))


def test_a_delay_of_three_milliseconds_is_a_time_skew_and_nothing_else():
    found = diagnose_trace(trace_of(late_torque(0.003)), PROFILE)
    assert [cause.name for cause in found.causes] == ["time-skew"]
    assert found.unexplained == ()
    assert found.data_flags == ()
    skew = found.causes[0].parameters["skew_s"]
    assert abs(skew["value"] - 0.003) < 5.0 * skew["std"] + 2e-5


def test_the_signal_in_a_late_channel_has_its_whole_ripple():
    record = record_of(trace_of(late_torque(0.003)))
    fit, _ = white_fit(record)
    _, angle, _, accel = shaft()
    known = torque_at(angle, accel) - record.fixed_nm
    before, after = (
        float(np.std((signal - known)[record.valid]))
        for signal in (fit.fitted_nm, signal_in_channel(record, fit.fitted_nm))
    )
    assert before > 0.03
    assert after < 0.004


def test_the_signal_of_a_channel_in_time_is_left_as_fitted():
    _, angle, _, accel = shaft()
    record = record_of(trace_of(torque_at(angle, accel)))
    fit, _ = white_fit(record)
    assert signal_in_channel(record, fit.fitted_nm) is fit.fitted_nm


def test_a_friction_that_changes_with_the_angle_is_left_unexplained_at_its_order():
    _, angle, speed, accel = shaft()
    friction = 0.03 * 2.0 / np.pi * np.arctan(speed / 0.5) * np.cos(2.0 * angle + 0.4)
    found = diagnose_trace(trace_of(torque_at(angle, accel) + friction), PROFILE)
    assert found.causes == ()
    (place,) = found.unexplained
    assert place.domain == "motor-order"
    assert place.location == pytest.approx(2.0, abs=0.02)


def test_drag_by_the_square_of_the_speed_is_no_viscous_friction():
    _, angle, speed, accel = shaft()
    drag = 0.06 * speed * np.abs(speed) / 90.0**2
    found = diagnose_trace(trace_of(torque_at(angle, accel) + drag), PROFILE)
    assert found.causes == ()
    assert [place.domain for place in found.unexplained] == ["velocity"]


def test_a_prediction_of_a_short_record_has_samples_to_train_on():
    n = 1_800
    _, angle, _, accel = shaft(n)
    record = record_of(trace_of(3.0 + torque_at(angle, accel), n))
    # a noise with a memory as long as the record
    kernel = np.concatenate([[1.0], np.zeros(n - 1)])
    fit, _ = white_fit(record)
    white = Whitener(kernel, NOISE_NM, record.valid, record.valid)
    (predicted,) = held_out_residuals(record, fit, white, [None])
    assert predicted.rms_nm == pytest.approx(NOISE_NM, rel=0.2)


def test_sums_over_uneven_positions_are_those_of_the_definition():
    rng = np.random.default_rng(8)
    positions = np.sort(rng.uniform(3.0, 40.0, 700))
    column = rng.standard_normal(700)
    transform = plan_transform(positions, 0.005, 0.25, 12.0)
    exact = np.exp(-2j * np.pi * np.multiply.outer(transform.grid, positions)) @ column
    # single precision of the largest sum that there can be
    assert np.abs(transform(column) - exact).max() < 3e-6 * np.abs(column).sum()


def bent_arm(seed, bend_rad=0.15, tilt_rad=-0.08, noise_nm=0.005):
    """Readings of an arm that bends by its own cosine, the weight hung below its line."""
    rng = np.random.default_rng(seed)
    rows, number, clock = [], 0, 0.0
    for place in range(4):
        for way, name in ((1.0, "cw"), (-1.0, "ccw")):
            for k, mass in enumerate((0.0, 2.0, 4.0, 6.0, 8.0, 6.0, 4.0, 2.0, 0.0)):
                pull, angle = mass * 9.8065 * 0.5, 0.0
                for _ in range(40):
                    angle = bend_rad * pull / 40.0 * np.cos(tilt_rad + angle)
                true = pull * (np.cos(tilt_rad + angle) / np.cos(tilt_rad))
                volts = (way * true + noise_nm * rng.standard_normal()) / 6.6
                series = "up" if k < 5 else "down"
                rows.append((number, 0.5 * np.pi * place, way * pull, volts, clock, name, series))
                clock += 30.0
            number += 1
            clock += 200.0
    return rows


def test_an_arm_that_bends_far_is_never_a_certain_limit():
    for seed in (1, 2):
        readings = tuple(
            LoadReading(
                experiment=str(number),
                position_rad=position,
                range="full",
                direction=direction,
                series=series,
                torque_nm=torque,
                reading_v=volts,
                time_s=clock,
            )
            for number, position, torque, volts, clock, direction, series in bent_arm(seed)
        )
        found = diagnose_loads(Loads(readings, source="bent arm"), PROFILE)
        names = {n for c in found.causes for n in (c.name, *c.group, *c.rivals)}
        assert "arm-sag" in names


DATA = os.environ.get("HDBENCH_DATA")


@pytest.mark.skipif(not DATA, reason="HDBENCH_DATA is not set")
def test_the_weight_of_a_robot_arm_is_named_on_one_sweep_and_its_twin_beside_it():
    source = Path(DATA) / "lara8_dual_encoder" / "validate_joint3_sweep.csv"
    rows = np.genfromtxt(source, delimiter=",", names=True)
    columns = {
        "time_s": rows["Timestamp"] - rows["Timestamp"][0],
        "torque_nm": rows["joint_torque_current_3"],
        "motor_velocity_rad_s": 101.0 * rows["joint_velocity_3"],
    }
    found = diagnose_trace(Trace(columns), PROFILE)
    names = [cause.name for cause in found.causes]
    assert names[0] == "load-gravity"
    # one sweep of less than a turn cannot tell the weight from a misalignment
    assert "misalignment" in found.causes[0].group
    assert "time-skew" not in names
    gain = found.extended["heldout_rms_nm"] / found.simulated["heldout_rms_nm"]
    assert gain < 0.4
