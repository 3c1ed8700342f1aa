"""A plan is refused where the bench cannot do it, before anything is opened."""

import pytest

from hdbench.devices.feasibility import check_drives
from hdbench.errors import ProfileError, UsageError
from hdbench.profile import load_profile
from hdbench.session.planning import check_plan
from hdbench.session.plans import Acquire, Plan

REPORT = load_profile("cim-tr-97-06").data


def plan(wave, duration_s=4.0, period_s=1e-3):
    step = Acquire(wave=wave, sample_period_s=period_s, duration_s=duration_s)
    return Plan("ripple", (step,), duration_s)


def sine(amplitude_v, frequency_hz):
    changes = {"wave": "sine", "bias_v": 0.0, "amplitude_v": amplitude_v}
    return REPORT.ripple.reference.model_copy(update={**changes, "frequency_hz": frequency_hz})


def limited(travel_rad):
    limits = REPORT.limits.model_copy(update={"travel_rad": travel_rad})
    return REPORT.model_copy(update={"limits": limits})


def test_a_motion_beyond_the_limit_of_travel_is_refused_from_the_profile_alone():
    # a sine of speed v at f goes v/(pi f) from where it began: 1 V, 56.25 rad/s/V, 0.5 Hz
    far_rad = REPORT.servo.velocity_gain_rad_s_per_v / (3.141592653589793 * 0.5)
    check_plan(plan(sine(1.0, 0.5)), limited(1.01 * far_rad))
    with pytest.raises(UsageError, match="travel") as told:
        check_plan(plan(sine(1.0, 0.5)), limited(0.99 * far_rad))
    assert "travel_rad" in told.value.fix


def test_a_bench_without_a_limit_of_travel_turns_as_far_as_it_likes():
    check_plan(plan(sine(1.0, 0.5)), REPORT)


@pytest.mark.parametrize(
    ("name", "key"),
    [("seneca-z-sg", "daq.output"), ("laumas-tlb4", "daq.output")],
)
def test_a_motion_is_refused_where_no_device_of_the_profile_has_an_output(name, key):
    data = load_profile(name).data
    slow = plan(sine(1.0, 0.01), 100.0, data.daq.sample_period_s)
    with pytest.raises(UsageError, match="no output") as told:
        check_plan(slow, data)
    assert key in told.value.where
    # nothing moves with the drive disabled
    check_plan(plan(None, 100.0, data.daq.sample_period_s), data)


@pytest.mark.parametrize("name", ["cim-tr-97-06", "di-2108-ek9000", "labjack-t7"])
def test_a_bench_that_can_drive_may(name):
    check_drives(load_profile(name).data, "the run")


def test_what_a_device_does_not_have_is_refused_from_the_profile_alone():
    data = load_profile("labjack-t7").data
    other = data.model_copy(update={"daq": data.daq.model_copy(update={"model": "T8"})})
    with pytest.raises(ProfileError, match="T8 is not supported"):
        check_plan(plan(None), other)
