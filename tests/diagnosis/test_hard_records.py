"""Records that invite a wrong name: short, slow, coloured, or with two like effects."""

import numpy as np
import pytest
from scipy.signal import lfilter
from swinging_shaft import NOISE_NM, swing, trace_of

from hdbench.diagnosis import diagnose_trace
from hdbench.model import BenchModel
from hdbench.profile import load_profile

PROFILE = load_profile("cim-tr-97-06")


def record(motion, extra, *, n, period_s=1e-3, noise_nm=NOISE_NM, pole=0.0, seed=0):
    """Return a record of a speed that swings: mean, size and period of the swing."""
    time = np.arange(n) * period_s
    speed, angle, torque = swing(time, *motion)
    white = np.sqrt(1.0 - pole**2) * np.random.default_rng(seed).standard_normal(n + 200)
    torque += noise_nm * lfilter([1.0], [1.0, -pole], white)[200:] + extra(time, angle, speed)
    return trace_of(time, speed, angle, torque)


@pytest.mark.parametrize(
    ("tone_hz", "period_s", "n", "pole"),
    [
        pytest.param(5.0, 5e-3, 2400, 0.9, marks=pytest.mark.campaign),
        (50.02, 5e-3, 1200, 0.0),
        pytest.param(21.3, 1e-3, 12_000, 0.0, marks=pytest.mark.campaign),
    ],
)
def test_a_tone_on_a_swinging_speed_is_not_taken_for_noise(tone_hz, period_s, n, pole):
    def tone(time, angle, speed):
        return 0.3 * np.cos(2.0 * np.pi * tone_hz * time + 1.0)

    trace = record((34.0, 20.0, 6.0), tone, n=n, period_s=period_s, noise_nm=0.01, pole=pole)
    result = diagnose_trace(trace, PROFILE)
    (cause,) = result.causes
    assert result.unexplained == ()
    place = cause.parameters["frequency_hz"]
    # four standard deviations: 6e-5 that a right interval misses
    assert abs(place.value - tone_hz) < 4.0 * place.std


@pytest.mark.parametrize("records", [2, pytest.param(8, marks=pytest.mark.campaign)])
def test_coloured_noise_of_a_short_slow_record_has_no_name(records):
    named = 0
    for seed in range(records):
        trace = record(
            (60.0, 20.0, 5.0),
            lambda time, angle, speed: 0.0,
            n=1200,
            period_s=5e-3,
            pole=0.9,
            seed=seed,
        )
        named += diagnose_trace(trace, PROFILE).verdict != "nothing-found"
    # 1 % each: 0.3 % that two of eight have a finding
    assert named <= records // 8


def test_less_than_an_output_turn_keeps_the_given_misalignment():
    def arc(time, angle, speed):
        return 1.0 * np.cos(angle / 100.0 + 0.4)

    trace = record((50.0, 10.0, 4.0), arc, n=5000)
    given = BenchModel.from_profile(PROFILE.data)
    result = diagnose_trace(trace, PROFILE, model=given)
    pictures = result.pictures
    left = (pictures.measured_nm - pictures.extended_nm)[~pictures.masked]
    # what the file simulates is what the fit left: noise of 0.05 N m, known to 1 % by 5000 samples
    assert np.sqrt(np.mean(left**2)) == pytest.approx(0.05, rel=0.04)
    assert result.model.misalignment[0] > 0.5


def test_a_short_arc_says_nothing_about_a_misalignment_and_leaves_it():
    trace = record((5.0, 1.0, 2.0), lambda time, angle, speed: 0.0, n=3000, noise_nm=0.5)
    given = BenchModel.from_profile(PROFILE.data)
    flat = diagnose_trace(
        trace.with_columns(
            torque_nm=trace["torque_nm"]
            + given.misalignment[0]
            * np.cos(trace["motor_angle_rad"] / 100.0 + given.misalignment[1])
        ),
        PROFILE,
    )
    amplitude, phase = flat.model.misalignment
    # noise of 0.5 / sqrt(3000) = 9 mN m over 0.15 rad cannot move a cosine of the prior by more
    # than some tenths of it
    assert amplitude == pytest.approx(given.misalignment[0], rel=0.3)
    assert phase == pytest.approx(given.misalignment[1], abs=0.3)


def test_two_like_effects_do_not_hide_each_other_below_the_materiality_line():
    def friction(time, angle, speed):
        return 0.3 * np.tanh(speed / 1.5) + 0.0012 * speed

    result = diagnose_trace(record((0.0, 100.0, 5.0), friction, n=10_000), PROFILE)
    names = {name for cause in result.causes for name in (cause.name, *cause.group)}
    assert names & {"coulomb-friction", "stribeck-friction"}
