"""Causes that a record can show; columns take whole records at a time."""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hdbench.model import Motion, catalogue, shape_bounds

Make = Callable[..., Motion]


def steady(make: Make, **replaced: Any) -> Motion:
    """Return 20 s at 60 rad/s: two output turns need 21 s, one is there."""
    time = np.arange(20_000) * 1e-3
    values: dict[str, Any] = {
        "time_s": time,
        "velocity_rad_s": np.full(20_000, 60.0),
        "angle_rad": 60.0 * time,
        "acceleration_rad_s2": np.zeros(20_000),
        "output_angle_rad": 0.6 * time,
        "angle_source": "velocity",
        "load_torque_nm": None,
        "ripple_slope_nm_per_rad": None,
    }
    return make(20_000, **{**values, **replaced})


def test_a_constant_speed_without_load_shows_what_it_can(make_motion):
    motion = steady(make_motion)
    silent = {name for name, cause in catalogue().items() if cause.applicable(motion) is not None}
    assert silent == {
        "load-dependent-ripple", "torsional-resonance", "tooth-mesh", "gain-ripple",
        "position-dependent-gain", "coulomb-friction", "viscous-friction", "stribeck-friction",
        "load-dependent-friction", "presliding", "gain-error", "cubic-nonlinearity", "hysteresis",
        "backlash", "saturation", "side-force", "direction-asymmetry", "inertia-error",
        "time-skew", "cubic-stiffness", "piecewise-stiffness", "creep", "speed-dependent-noise",
        "asymmetric-friction", "transmission-error",
    }  # fmt: skip


def up_to(end: float) -> np.ndarray:
    return np.linspace(0, end, 20_000)


BOTH_WAYS = np.repeat([100.0, -100.0], 10_000)
STEPS = np.arange(20_000)
ZERO, ONES = np.zeros(20_000), np.ones(20_000)
CANNOT_SHOW = [
    ("load-dependent-ripple", {}, "no load_torque_nm"),
    ("gain-ripple", {"load_torque_nm": ZERO}, "zero throughout"),
    ("torsional-resonance", {}, "more than 5 %"),
    ("kinematic-error", {"inertia_nm_s2": 0.0}, "no inertia"),
    ("cubic-stiffness", {}, "no load_torque_nm"),
    ("cubic-stiffness", {"load_torque_nm": ONES, "time_s": 1.0 * STEPS}, "one sample per 1 s"),
    ("piecewise-stiffness", {}, "no load_torque_nm"),
    ("backlash", {"load_torque_nm": up_to(30)}, "needed: both signs"),
    ("side-force", {}, "no load_torque_nm"),
    ("hysteresis", {"load_torque_nm": up_to(30)}, "rises by 30 N m and falls"),
    ("position-dependent-gain", {}, "no load_torque_nm"),
    ("presliding", {}, "keeps one direction"),
    ("creep", {}, "no load_torque_nm"),
    ("creep", {"load_torque_nm": STEPS * 1e-3, "time_s": STEPS * 1e-5}, "0.2 s"),
    ("time-skew", {}, "torque is constant"),
    ("crosstalk", {"motor_current_a": None}, "no motor_current_a"),
    ("crosstalk", {"motor_current_a": np.full(20_000, 2.0)}, "is constant"),
    ("angular-misalignment", {"output_angle_rad": up_to(3)}, "0.477 turns"),
    ("gain-error", {"load_torque_nm": ZERO}, "zero throughout"),
    ("tooth-mesh", {}, "motor_angle_rad or encoder_count"),
    ("coulomb-friction", {}, "keeps one direction"),
    ("viscous-friction", {}, "more than 5 %"),
    ("inertia-error", {}, "changes faster"),
    ("asymmetric-friction", {}, "one direction alone"),
    ("asymmetric-friction", {"velocity_rad_s": BOTH_WAYS}, "varies by 0 rad/s of 100"),
    ("cogging", {"angle_rad": up_to(6)}, "0.955 turns"),
    ("transmission-error", {}, "needed: a ripple"),
    ("transmission-error", {"ripple_slope_nm_per_rad": ZERO}, "does not follow the motor angle"),
    (
        "transmission-error",
        {"ripple_slope_nm_per_rad": ONES, "output_angle_rad": up_to(3)},
        "0.477 turns",
    ),
    ("ripple-harmonic", {"angle_rad": up_to(6)}, "0.955 turns"),
    ("misalignment", {"output_angle_rad": up_to(1.5)}, "output covers 0.239"),
    ("mains-hum", {"time_s": STEPS * 0.0125}, "80 samples/s"),
    ("structural-tone", {"time_s": STEPS * 1e-5}, "0.2 s"),
    ("warm-up", {"time_s": STEPS * 1e-5}, "0.2 s"),
    ("stribeck-friction", {"velocity_rad_s": BOTH_WAYS}, "0 samples move slower"),
]


@pytest.mark.parametrize(("name", "change", "words"), CANNOT_SHOW)
def test_a_record_that_cannot_show_a_cause_says_why(name, change, words, make_motion):
    assert words in str(catalogue()[name].applicable(steady(make_motion, **change)))


def test_a_record_with_everything_shows_every_cause(make_motion):
    time = np.arange(30_000) * 1e-3
    motion = make_motion(30_000, time_s=time, velocity_rad_s=60.0 * np.sin(time))
    assert [name for name, c in catalogue().items() if c.applicable(motion) is not None] == []


def test_lost_samples_do_not_count_for_what_a_record_shows(make_motion):
    velocity = np.full(20_000, 60.0)
    velocity[7] = -60.0
    valid = np.arange(20_000) != 7
    friction = catalogue()["coulomb-friction"]
    assert friction.applicable(steady(make_motion, velocity_rad_s=velocity)) is None
    assert friction.applicable(steady(make_motion, velocity_rad_s=velocity, valid=valid))


def test_shapes_are_searched_where_the_record_can_show_them(make_motion):
    motion = steady(make_motion, time_s=100.0 + np.arange(20_000) * 0.009)
    bands = {n: shape_bounds(c, motion) for n, c in catalogue().items()}
    # 9 ms period: half the sampling rate is 55.6 Hz, which leaves only the European mains
    assert bands["mains-hum"] == {"frequency_hz": ((49.5, 50.5),)}
    low, high = bands["structural-tone"]["frequency_hz"][0]
    assert low == 0.5
    # the period is a difference of times near 280 s: 1e-16 * 280 / 0.009
    assert high == pytest.approx(1 / 0.018, rel=1e-11, abs=0)
    assert bands["zero-step"] == {"step_time_s": ((100.0, float(motion.time_s[-1])),)}
    assert bands["ripple-harmonic"] == {"order": ((0.1, 60.0),)}


def test_shapes_in_torque_stay_where_the_load_reaches(make_motion):
    load = np.linspace(-10.0, 20.0, 400)
    motion = make_motion(load_torque_nm=load, inertia_nm_s2=0.0)
    bands = {n: shape_bounds(c, motion) for n, c in catalogue().items()}
    assert bands["backlash"] == {"play_nm": ((0.0001, 6.0),)}
    assert bands["saturation"] == {"limit_nm": ((10.0, 1200.0),), "sharpness": ((1.0, 64.0),)}
    assert bands["hysteresis"] == {"yield_nm": ((0.3, 15.0),)}
    assert bands["piecewise-stiffness"]["knee_nm"] == ((2.0, 20.0),)
    span = float(motion.time_s[-1] - motion.time_s[0])
    # two median samples are faster than the fastest creep there is
    assert bands["creep"] == {"time_constant_s": ((0.5, 3.0 * span),)}
    resting = make_motion(load_torque_nm=np.zeros(400), inertia_nm_s2=0.0)
    assert shape_bounds(catalogue()["backlash"], resting) == {"play_nm": ()}


# 40 s at 1 kHz
N = 40_000


@pytest.fixture(scope="module")
def long_motion(make_motion: Make) -> Motion:
    rng = np.random.default_rng(5)
    time = np.arange(N) * 1e-3
    return make_motion(
        N,
        time_s=time,
        velocity_rad_s=200.0 * np.sin(0.1 * time),
        angle_rad=2000.0 * (1.0 - np.cos(0.1 * time)),
        acceleration_rad_s2=20.0 * np.cos(0.1 * time) + rng.normal(0.0, 3.0, N),
        output_angle_rad=20.0 * (1.0 - np.cos(0.1 * time)),
        load_torque_nm=20.0 * np.sin(0.7 * time) + rng.normal(0.0, 0.05, N),
    )


def lines_executed(work: Callable[[], object], enough: int) -> int:
    """Count lines of Python that run, up to enough."""
    count = 0

    def trace(_frame: object, event: str, _argument: object) -> object:
        nonlocal count
        if count >= enough:
            return None
        count += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
    return count


@pytest.mark.parametrize("name", [name for name, c in catalogue().items() if c.additive])
def test_columns_take_no_step_of_python_for_a_sample(name, long_motion, middle_shape):
    cause = catalogue()[name]
    shape = middle_shape(cause)
    cause.columns(long_motion, shape)  # what is made once is made
    # whole columns at a time take tens of lines; what is carried on from turn to turn of the load
    # or in blocks takes some ten thousand; a step for each sample takes N at the least
    assert lines_executed(lambda: cause.columns(long_motion, shape), N) < N // 4
