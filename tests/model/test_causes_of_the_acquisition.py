"""Causes of the acquisition, of an angle that is off, of poles and of friction by direction."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hdbench.errors import DataError
from hdbench.model import (
    BenchModel,
    CauseTerm,
    Motion,
    catalogue,
    cause_parameters,
    check_term,
    motion_from_trace,
    simulate_like,
    term_torque_nm,
    with_signal,
)
from hdbench.records.trace import Trace

Make = Callable[..., Motion]
NO_TORQUE = [name for name, cause in catalogue().items() if not cause.additive]


def true_motion(motion: Motion, name: str, **shape: float) -> Motion:
    change = catalogue()[name].change_motion
    assert change is not None
    return change(motion, shape)


@pytest.mark.parametrize("name", NO_TORQUE)
def test_a_cause_that_is_no_torque_has_no_column(name, make_motion):
    cause = catalogue()[name]
    shape = {p.name: p.upper for p in cause.shape}
    assert cause.shape
    assert cause.linear == ()
    assert cause.columns(make_motion(), shape).shape == (400, 0)
    assert (term_torque_nm(CauseTerm(name, shape, ()), make_motion()) == 0.0).all()
    of_angle_or_clock = name in {"missed-samples", "encoder-slip", "tacho-ripple"}
    assert (cause.change_motion is not None) == of_angle_or_clock


def moved(bench, time, **columns):
    return motion_from_trace(Trace({"time_s": time, **columns}), bench)


def test_a_slip_is_taken_out_of_the_angle(bench):
    time = np.arange(2000) * 1e-3
    angle = 30.0 * time + np.where(time >= 0.7, 0.25, 0.0)
    speed = np.full(2000, 30.0)
    recorded = moved(bench, time, motor_velocity_rad_s=speed, motor_angle_rad=angle)
    found = true_motion(recorded, "encoder-slip", step_time_s=0.7, slip_rad=0.25)
    # angles up to 60 rad: doubles 7e-15 apart
    np.testing.assert_allclose(found.angle_rad, 30.0 * time, rtol=0, atol=2e-14)
    np.testing.assert_allclose(found.output_angle_rad, 0.3 * time, rtol=0, atol=2e-16)


def test_an_acceleration_by_the_angle_is_formed_again(bench):
    time = np.arange(1500) * 1e-3
    angle = 30.0 * time + 20.0 * time**2
    speed = 30.0 + 40.0 * time + np.random.default_rng(1).normal(0.0, 0.5, 1500)
    columns = {"motor_velocity_rad_s": speed}
    slipped = angle + np.where(time >= 0.7, 0.01, 0.0)
    recorded = moved(bench, time, **columns, motor_angle_rad=slipped)
    assert recorded.acceleration_source == "angle"
    assert np.abs(recorded.acceleration_rad_s2 - 40.0).max() > 50.0
    found = true_motion(recorded, "encoder-slip", step_time_s=0.7, slip_rad=0.01)
    # angles of 75 rad: doubles 1e-14 apart, over (1 ms)^2 where a window ends
    np.testing.assert_allclose(found.acceleration_rad_s2, 40.0, rtol=0, atol=1e-7)
    lost = np.delete(np.arange(1500), np.arange(700, 720))
    columns = {"motor_velocity_rad_s": speed[lost], "motor_angle_rad": angle[lost]}
    counted = moved(bench, time[: len(lost)], **columns)
    # the jump of the angle makes it the worse source: asked for all the same
    recorded = replace(counted, acceleration_source="angle")
    found = true_motion(recorded, "missed-samples", step_time_s=0.7, missed_s=0.020)
    np.testing.assert_allclose(found.acceleration_rad_s2, 40.0, rtol=0, atol=1e-7)


def test_a_slip_of_the_motor_leaves_a_measured_output_alone(make_motion):
    motion = make_motion(output_source="output_angle_rad")
    found = true_motion(motion, "encoder-slip", step_time_s=3.1, slip_rad=1.0)
    assert (found.output_angle_rad == motion.output_angle_rad).all()
    late = motion.time_s >= 3.1
    assert (found.angle_rad[late] == motion.angle_rad[late] - 1).all()


def test_missed_samples_are_given_their_time_and_angle(bench):
    true = np.delete(np.arange(2000) * 1e-3, np.arange(500, 540))
    # the counter goes on counting as if nothing had been lost
    time = np.arange(len(true)) * 1e-3
    speed = np.full(len(true), 30.0)
    recorded = moved(bench, time, motor_velocity_rad_s=speed)
    found = true_motion(recorded, "missed-samples", step_time_s=0.5, missed_s=0.040)
    # sums of 2000 steps
    np.testing.assert_allclose(found.time_s, true, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.angle_rad, 30.0 * true, rtol=0, atol=1e-10)
    measured = moved(bench, time, motor_velocity_rad_s=speed, motor_angle_rad=30.0 * true)
    kept = true_motion(measured, "missed-samples", step_time_s=0.5, missed_s=0.040)
    assert (kept.angle_rad == measured.angle_rad).all()
    late = true_motion(recorded, "missed-samples", step_time_s=99.0, missed_s=0.040)
    assert (late.time_s == time).all()
    assert (late.angle_rad == recorded.angle_rad).all()


def test_a_tachos_ripple_is_taken_out_of_speed_angle_and_acceleration(bench):
    time = np.arange(4000) * 1e-3
    angle = 20.0 * time + 5.0 * time**2
    speed = 20.0 + 10.0 * time
    tacho = speed * (1.0 + 0.02 * np.cos(14.0 * angle) - 0.01 * np.sin(14.0 * angle))
    recorded = moved(bench, time, motor_velocity_rad_s=tacho, motor_angle_rad=angle)
    shape = {"order": 14.0, "cosine": 0.02, "sine": -0.01}
    found = true_motion(recorded, "tacho-ripple", **shape)
    np.testing.assert_allclose(found.velocity_rad_s, speed, rtol=1e-13)
    assert (found.angle_rad == angle).all()
    integrated = moved(bench, time, motor_velocity_rad_s=tacho)
    found = true_motion(integrated, "tacho-ripple", **shape)
    # the integrated angle trails the true one by half a sample of the 40 rad/s that it gained,
    # which leaves a share of 14 * 0.02 of the ripple; the ripple's own integral is 1.6 mrad
    assert np.abs(found.angle_rad - angle).max() < 0.022
    for name, want in (("velocity_rad_s", speed), ("acceleration_rad_s2", 10.0)):
        before, after = (np.std(getattr(m, name) - want) for m in (integrated, found))
        assert after < 0.3 * before


def test_the_simulation_uses_the_motion_that_the_bench_had(bench):
    time = np.arange(3000) * 1e-3
    angle = 40.0 * time
    slipped = angle + np.where(time >= 1.5, 0.3, 0.0)
    model = BenchModel(0.0, 0.0, ((2.0, 0.4, 0.6),), (0.0, 0.0)).with_cause(
        CauseTerm("ripple-harmonic", {"order": 7.0}, (0.1, 0.0))
    )
    columns = {"motor_velocity_rad_s": np.full(3000, 40.0), "motor_angle_rad": slipped}
    trace = Trace({"time_s": time, **columns})
    faulty = model.with_cause(CauseTerm("encoder-slip", {"step_time_s": 1.5, "slip_rad": 0.3}, ()))
    got = simulate_like(trace, bench, faulty)["torque_nm"]
    want = 0.4 * np.cos(2 * angle + 0.6) + 0.1 * np.cos(7 * angle)
    # angles of 840 rad: doubles 1e-13 apart
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-12)
    plain = simulate_like(trace, bench, model)["torque_nm"]
    assert np.abs(plain - want).max() > 0.2


def term_of_an_error(motor: complex, once: complex, twice: complex) -> CauseTerm:
    """Return e = Re(motor exp(-i theta_m) + once exp(-i theta_o) + twice exp(-2 i theta_o))."""
    numbers = [part for z in (motor, once, twice) for part in (z.real, z.imag)]
    return CauseTerm("transmission-error", {}, (*numbers, 0.0))


def turning_motion(make: Make) -> Motion:
    time = np.arange(4000) * 1e-3
    angle = 60.0 * time + 300.0 * time**2
    return make(
        4000,
        time_s=time,
        angle_rad=angle,
        output_angle_rad=angle / 100.0,
        velocity_rad_s=60.0 + 600.0 * time,
        acceleration_rad_s2=np.full(4000, 600.0),
        ripple_slope_nm_per_rad=None,
    )


@pytest.mark.parametrize("size", [1e-5, 1e-4])
def test_an_angle_that_is_off_moves_the_phase_of_every_order(size, bench, make_motion):
    motion = turning_motion(make_motion)
    cogging = CauseTerm("cogging", {"order": 12.0}, (0.2, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0))
    base = BenchModel.from_profile(bench).with_cause(cogging)
    model = base.with_cause(term_of_an_error(0.5j * size, size, -0.3 * size))
    o = motion.output_angle_rad
    error = size * (0.5 * np.sin(motion.angle_rad) + np.cos(o) - 0.3 * np.cos(2 * o))
    true = motion.angle_rad - error
    want = 1.725e-4 * 600.0 + motion.load_torque_nm + 0.9 * np.cos(o + 0.3)
    want = want + 0.4 * np.cos(2 * true + 0.6) + 0.2 * np.cos(4 * true - 1.1)
    want = want + 0.2 * np.cos(12 * true) + 0.1 * np.sin(36 * true)
    # an error below 2e-5 rad takes the slope over that way: 3.4 N m/rad^2 times half of it is off
    np.testing.assert_allclose(model.torque_nm(motion), want, rtol=0, atol=265.0 * 2e-5 * size)
    # and without it the same torque is off by far more
    assert np.abs(base.torque_nm(motion) - want).max() > 5.0 * size


def test_the_slope_of_a_signal_leaves_the_output_angle_alone(bench, make_motion):
    motion = turning_motion(make_motion)
    model = BenchModel.from_profile(bench)
    whole = with_signal(motion, model.torque_nm)
    a = motion.angle_rad
    want = -0.8 * np.sin(2 * a + 0.6) - 0.8 * np.sin(4 * a - 1.1)
    # sums of some 10 N m are rounded to 2e-15, over a step of 2e-5 rad
    np.testing.assert_allclose(whole.ripple_slope_nm_per_rad, want, rtol=0, atol=1e-6)
    assert (whole.simulated_nm == model.torque_nm(motion)).all()


def test_an_acceleration_of_the_angle_has_the_second_derivative_of_its_error(make_motion):
    motion = replace(turning_motion(make_motion), acceleration_source="angle")
    columns = catalogue()["transmission-error"].columns(motion, {})
    rate, gear = 60.0 + 600.0 * motion.time_s, 100.0
    # d2/dt2 cos(k theta) = -(k rate)^2 cos(k theta) - k 600 sin(k theta), and so on
    for place, k in ((0, 1.0), (2, 1.0 / gear), (4, 2.0 / gear)):
        angle, way = k * motion.angle_rad, k * rate
        cosine = -(way**2) * np.cos(angle) - k * 600.0 * np.sin(angle)
        sine = -(way**2) * np.sin(angle) + k * 600.0 * np.cos(angle)
        want = -1.725e-4 * np.column_stack([cosine, sine])
        np.testing.assert_allclose(columns[:, place : place + 2], want, rtol=1e-9, atol=1e-12)
    # the load behind a spring turns too slowly to be seen
    assert not columns[:, 6].any()
    by_velocity = replace(motion, acceleration_source="velocity")
    assert not catalogue()["transmission-error"].columns(by_velocity, {}).any()


def test_without_a_simulated_torque_an_angle_that_is_off_gives_none(make_motion):
    motion = make_motion(ripple_slope_nm_per_rad=None)
    assert not catalogue()["transmission-error"].columns(motion, {}).any()


def test_the_true_torque_keeps_the_friction_and_nothing_made_of_the_ripple(bench):
    model = BenchModel.from_profile(bench)
    for term in (
        term_of_an_error(0.01 + 0j, 0.02j, 0.001 + 0j),
        CauseTerm("cogging", {"order": 12.0}, (0.1, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.02)),
        CauseTerm("asymmetric-friction", {}, (-0.24, -0.0369)),
    ):
        model = model.with_cause(term)
    time = np.arange(3000) * 1e-3
    angle = 100.0 * (1 - np.cos(2 * time))
    columns = {"motor_velocity_rad_s": 200.0 * np.sin(2 * time), "motor_angle_rad": angle}
    trace = Trace({"time_s": time, **columns})
    simulated = simulate_like(trace, bench, model)
    quiet = replace(model, ripple=(), misalignment=(0.0, 0.0), causes=model.causes[2:])
    kept = simulate_like(trace, bench, quiet)["torque_nm"]
    np.testing.assert_allclose(simulated["torque_true_nm"], kept, rtol=0, atol=1e-12)


def test_what_is_counted_is_whole_and_what_rolls_is_not():
    (rolling,), (counted,) = catalogue()["bearing-defect"].shape, catalogue()["cogging"].shape
    for orders, rolls, is_counted in (
        ((10.35, 12.65, 4.95, 0.45, 0.2, 19.95), True, False),
        ((3.0, 12.0, 12.015, 60.0), False, True),
        ((1.0, 2.0, 4.0, 61.0), False, False),
    ):
        for order in orders:
            assert (rolling.contains(order), counted.contains(order)) == (rolls, is_counted)
    with pytest.raises(DataError, match=r"needed: 11\.02 to 11\.98 or 12\.02 to 12\.98 1"):
        check_term(CauseTerm("bearing-defect", {"order": 12.0}, (0.0,) * 6), where="here")


def test_an_error_of_the_angle_is_told_as_amplitude_and_phase():
    table = cause_parameters(term_of_an_error(0j, 0.003 + 0.004j, 0j))
    assert table["amplitude_output_1_rad"] == {"value": 0.005, "std": None, "unit": "rad"}
    # cosine cos + sine sin = A cos(x + phase)
    assert table["phase_output_1_rad"]["value"] == pytest.approx(-math.atan2(4, 3), abs=1e-15)
