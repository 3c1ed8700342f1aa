"""A cause is held against speeds, directions and loads that its fit has not seen."""

import numpy as np

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.confirm.conditions import conditions_of, left_out_gains
from hdbench.diagnosis.fit.jointfit import fit_jointly
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.record import prepare_record
from hdbench.diagnosis.noise.whitened import Whitener
from hdbench.model import BenchModel, catalogue
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
NOISE_NM = 0.05


def staircase(friction):
    """Six speeds in both directions with a friction that is a function of speed."""
    rng = np.random.default_rng(7)
    levels = np.array([10.0, 40.0, 80.0, 130.0, 190.0, 260.0])
    speed = np.repeat(np.concatenate([levels, -levels]), 1500)
    time = np.arange(len(speed)) * 1e-3
    angle = np.cumsum(speed) * 1e-3
    torque = 0.4 * np.cos(2.0 * angle) + 0.2 * np.cos(4.0 * angle) + friction(speed)
    torque += NOISE_NM * rng.standard_normal(len(speed))
    columns = {"time_s": time, "motor_velocity_rad_s": speed, "motor_angle_rad": angle}
    return Trace({**columns, "torque_nm": torque})


def gains(friction, name):
    data = PROFILE.data
    trace = staircase(friction)
    masked = np.zeros(18_000, dtype=bool)
    record = prepare_record(trace, data, BenchModel.from_profile(data), masked)
    white = Whitener(np.ones(1), NOISE_NM, record.valid, record.valid)
    fit = fit_jointly(record, (Term(catalogue()[name], {}),), white)
    (found,) = left_out_gains(record, fit, white, [0])
    return record, found


def test_conditions_are_speeds_and_directions_and_no_load_without_one():
    record, _ = gains(lambda speed: 0.0 * speed, "viscous-friction")
    axes = {condition.axis for condition in conditions_of(record)}
    assert axes == {"velocity", "direction"}


def test_a_true_cause_gains_what_it_claims_where_it_was_not_fitted():
    _, found = gains(lambda speed: 0.002 * speed, "viscous-friction")
    assert len(found) >= 4
    for one in found:
        # the gain of an effect of e nats has the mean e or, where the baseline stood in for it
        # in the other conditions, more; its standard deviation is sqrt(2 e)
        spread = np.sqrt(2.0 * one.claimed_nats)
        assert one.gain_nats > 0.9 * one.claimed_nats - 5.0 * spread
        assert not one.against


def test_a_false_cause_loses_where_its_law_does_not_hold():
    def humped(speed):
        return 0.4 * np.sign(speed) * np.sin(np.pi * np.abs(speed) / 260.0)

    _, found = gains(humped, "viscous-friction")
    worst = min(found, key=lambda one: one.gain_nats)
    assert worst.against
    assert (worst.condition.axis, round(worst.condition.high)) == ("velocity", 260)


def test_what_conditions_say_stands_in_the_answer():
    body = diagnose_trace(staircase(lambda speed: 0.002 * speed), PROFILE).to_dict({})
    (cause,) = body["causes"]
    assert cause["name"] == "viscous-friction"
    told = cause["held_out_conditions"]
    assert {one["axis"] for one in told} <= {"velocity", "direction", "torque"}
    assert told
    assert all(one["gain_nats"] > 0.0 for one in told)


def test_noise_that_grows_with_torque_is_told_with_and_without_a_load_cell():
    rng = np.random.default_rng(3)
    time = np.arange(12_000) * 1e-3
    speed = 60.0 * np.sin(2.0 * np.pi * time / 4.0)
    angle = 120.0 / np.pi * (1.0 - np.cos(2.0 * np.pi * time / 4.0))
    inertia = 1.725e-4 * 30.0 * np.pi * np.cos(2.0 * np.pi * time / 4.0)
    ripple = 0.4 * np.cos(2.0 * angle) + 0.2 * np.cos(4.0 * angle) + inertia
    load = 20.0 * np.sin(2.0 * np.pi * time / 9.7)
    motion = {"time_s": time, "motor_velocity_rad_s": speed, "motor_angle_rad": angle}
    noise = rng.standard_normal(len(time))
    loaded = ripple + load + np.hypot(0.05, 0.006 * load) * noise
    free = ripple + 0.05 * np.hypot(1.0, 3.0 * ripple) * noise
    for extra in ({"torque_nm": loaded, "load_torque_nm": load}, {"torque_nm": free}):
        found = diagnose_trace(Trace({**motion, **extra}), PROFILE)
        assert found.causes == ()
        assert ("variance", "N m") in {(left.domain, left.unit) for left in found.unexplained}
