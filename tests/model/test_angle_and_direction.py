"""Causes of an angle that is off, of poles and of friction by direction, against plain formulas."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

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
    load_model,
    save_model,
    simulate_like,
    with_signal,
)
from hdbench.profile import Profile, ProfileData
from hdbench.records.trace import Trace

Make = Callable[..., Motion]


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
def test_an_angle_that_is_off_moves_the_phase_of_every_order(
    size: float, bench: ProfileData, make_motion: Make
) -> None:
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


def test_the_slope_of_a_signal_leaves_the_output_angle_alone(
    bench: ProfileData, make_motion: Make
) -> None:
    motion = turning_motion(make_motion)
    model = BenchModel.from_profile(bench)
    whole = with_signal(motion, model.torque_nm)
    a = motion.angle_rad
    want = -0.8 * np.sin(2 * a + 0.6) - 0.8 * np.sin(4 * a - 1.1)
    # sums of some 10 N m are rounded to 2e-15, over a step of 2e-5 rad
    np.testing.assert_allclose(whole.ripple_slope_nm_per_rad, want, rtol=0, atol=1e-6)
    assert (whole.simulated_nm == model.torque_nm(motion)).all()


def test_without_a_simulated_torque_an_angle_that_is_off_gives_none(make_motion: Make) -> None:
    motion = make_motion(ripple_slope_nm_per_rad=None)
    assert not catalogue()["transmission-error"].columns(motion, {}).any()


def test_the_new_causes_go_through_a_model_file_and_a_simulation(
    profile: Profile, bench: ProfileData, tmp_path: Path
) -> None:
    model = BenchModel.from_profile(bench)
    for term in (
        term_of_an_error(0.01 + 0j, 0.02j, 0.001 + 0j),
        CauseTerm("cogging", {"order": 12.0}, (0.1, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.02)),
        CauseTerm("asymmetric-friction", {}, (-0.24, -0.0369)),
    ):
        model = model.with_cause(term)
    save_model(tmp_path / "m.json", model, profile=profile, provenance={})
    again = load_model(tmp_path / "m.json")
    assert again.causes == model.causes
    time = np.arange(3000) * 1e-3
    trace = Trace(
        {
            "time_s": time,
            "motor_velocity_rad_s": 200.0 * np.sin(2 * time),
            "motor_angle_rad": 100.0 * (1 - np.cos(2 * time)),
        },
        "test",
    )
    one, two = simulate_like(trace, bench, model), simulate_like(trace, bench, again)
    assert one["torque_nm"].tobytes() == two["torque_nm"].tobytes()
    # a filter keeps the friction, and neither the ripple nor what is made of it
    quiet = replace(model, ripple=(), misalignment=(0.0, 0.0), causes=model.causes[2:])
    kept = simulate_like(trace, bench, quiet)["torque_nm"]
    np.testing.assert_allclose(one["torque_true_nm"], kept, rtol=0, atol=1e-12)


def test_forward_and_backward_friction_have_the_coefficients_that_are_told(
    make_motion: Make,
) -> None:
    speed = np.array([10.0, 100.0, 0.0, -10.0, -100.0])
    motion = make_motion(5, velocity_rad_s=speed)
    names = {
        "coulomb-friction": ({"transition_rad_s": 0.5}, 20.39),
        "viscous-friction": ({}, 0.2035),
    }
    torque = sum(
        value * catalogue()[name].columns(motion, shape)[:, 0]
        for name, (shape, value) in names.items()
    )
    both = catalogue()["asymmetric-friction"].columns(motion, {})
    torque = torque + both @ [-0.24, -0.0369]
    # tanh(20) is 1 to the last digit
    want = [20.15 + 1.666, 20.15 + 16.66, 0.0, -20.63 - 2.404, -20.63 - 24.04]
    np.testing.assert_allclose(torque, want, rtol=0, atol=1e-12)


def test_what_is_counted_is_whole_and_what_rolls_is_not() -> None:
    (rolling,), (counted,) = catalogue()["bearing-defect"].shape, catalogue()["cogging"].shape
    for order in (10.35, 12.65, 4.95, 0.45, 0.2, 19.95):
        assert rolling.contains(order)
        assert not counted.contains(order)
    for order in (3.0, 12.0, 12.015, 60.0):
        assert counted.contains(order)
        assert not rolling.contains(order)
    for order in (1.0, 2.0, 4.0, 61.0):
        assert not counted.contains(order)
        assert not rolling.contains(order)
    with pytest.raises(DataError, match=r"needed: 11\.02 to 11\.98 or 12\.02 to 12\.98 1"):
        check_term(CauseTerm("bearing-defect", {"order": 12.0}, (0.0,) * 6), where="here")


def test_an_error_of_the_angle_is_told_as_amplitude_and_phase() -> None:
    table = cause_parameters(term_of_an_error(0j, 0.003 + 0.004j, 0j))
    assert table["amplitude_output_1_rad"] == {"value": 0.005, "std": None, "unit": "rad"}
    # cosine cos + sine sin = A cos(x + phase)
    assert table["phase_output_1_rad"]["value"] == pytest.approx(-math.atan2(4, 3), abs=1e-15)
