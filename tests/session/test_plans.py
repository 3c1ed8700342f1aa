"""Plans are data, held against limits and abilities of the bench before anything is opened."""

import math
from dataclasses import replace

import pytest
from changing import with_keys

from hdbench.devices.feasibility import check_drives
from hdbench.errors import ProfileError, UsageError
from hdbench.profile import load_profile
from hdbench.profile.schema import ReferenceWave
from hdbench.session.calibrating.plan import calibration_plan, calibration_points
from hdbench.session.plans import Acquire, Plan, check_plan, misalignment_plan, ripple_plan

PROFILE = load_profile("cim-tr-97-06").data


def test_the_misalignment_plan_turns_the_output_twice_in_each_direction():
    plan = misalignment_plan(PROFILE)
    (acquire,) = [step for step in plan.steps if isinstance(step, Acquire)]
    half_s = 0.5 / acquire.wave.frequency_hz
    speed = acquire.wave.amplitude_v * PROFILE.servo.velocity_gain_rad_s_per_v
    steady_s = acquire.wave.duty * half_s - PROFILE.misalignment.settle_s
    turns = speed * steady_s / (2 * math.pi * 100.0)
    # exact up to float rounding of a handful of products
    assert turns == pytest.approx(PROFILE.misalignment.output_turns, rel=1e-12)
    rate = speed / (acquire.wave.rise * half_s)
    assert rate == pytest.approx(PROFILE.servo.max_acceleration_rad_s2 / 4.0, rel=1e-12)
    assert plan.duration_s == pytest.approx(2 * half_s, rel=1e-12)


@pytest.mark.parametrize("make", [calibration_plan, misalignment_plan, ripple_plan])
def test_the_built_in_profile_plans_within_its_own_limits(make):
    check_plan(make(PROFILE), PROFILE)


def test_every_step_outside_a_limit_is_named_at_once():
    with pytest.raises(UsageError) as error:
        check_plan(plan(ReferenceWave(wave="constant", bias_v=9.0), 700.0), PROFILE)
    what = [problem.what for problem in error.value.problems]
    assert any("reference 9 V is above 8 V" in text for text in what)
    assert any("motor speed" in text for text in what)
    assert any("duration 700 s is above 600 s" in text for text in what)


def test_a_limit_check_does_not_let_nan_through():
    step = replace(calibration_points(PROFILE)[3], torque_nm=math.nan)
    with pytest.raises(UsageError):
        check_plan(Plan("calibration", (step,), 1.0), PROFILE)


def test_a_load_beyond_the_converter_s_range_is_refused_before_anything_is_hung():
    with pytest.raises(UsageError, match=r"would read 13\.08 V; the range ends at 10 V"):
        check_plan(calibration_plan(PROFILE), with_keys(PROFILE, sensor={"gain_nm_per_v": 3.0}))


def plan(wave, duration_s=4.0, period_s=1e-3):
    return Plan("ripple", (Acquire(wave, period_s, duration_s),), duration_s)


def sine(frequency_hz):
    """Return a sine of 1 V."""
    told = {"wave": "sine", "bias_v": 0.0, "amplitude_v": 1.0, "frequency_hz": frequency_hz}
    return PROFILE.ripple.reference.model_copy(update=told)


def test_a_motion_beyond_the_limit_of_travel_is_refused_from_the_profile_alone():
    # a sine of speed v at f goes v/(pi f) from where it began: 1 V, 56.25 rad/s/V, 0.5 Hz
    far_rad = PROFILE.servo.velocity_gain_rad_s_per_v / (math.pi * 0.5)
    wide, narrow = (with_keys(PROFILE, limits={"travel_rad": k * far_rad}) for k in (1.01, 0.99))
    check_plan(plan(sine(0.5)), wide)
    with pytest.raises(UsageError, match="travel") as told:
        check_plan(plan(sine(0.5)), narrow)
    assert "travel_rad" in told.value.fix


@pytest.mark.parametrize("name", ["seneca-z-sg", "laumas-tlb4"])
def test_a_motion_is_refused_where_no_device_of_the_profile_has_an_output(name):
    data = load_profile(name).data
    with pytest.raises(UsageError, match="no output") as told:
        check_plan(plan(sine(0.01), 100.0, data.daq.sample_period_s), data)
    assert "daq.output" in told.value.where
    # nothing moves with the drive disabled
    check_plan(plan(None, 100.0, data.daq.sample_period_s), data)


@pytest.mark.parametrize("name", ["cim-tr-97-06", "di-2108-ek9000", "labjack-t7"])
def test_a_bench_that_can_drive_may(name):
    check_drives(load_profile(name).data, "the run")


def test_what_a_device_does_not_have_is_refused_from_the_profile_alone():
    data = load_profile("labjack-t7").data
    with pytest.raises(ProfileError, match="T8 is not supported"):
        check_plan(plan(None), with_keys(data, daq={"model": "T8"}))
