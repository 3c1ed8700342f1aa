"""Planning: separability of causes, against closed forms, all samples and other code."""

import math
import re

import numpy as np
import pytest

from hdbench.diagnosis.planning.blocks import blocks, full_protocol
from hdbench.diagnosis.planning.confusability import compare
from hdbench.diagnosis.planning.frame import Noise, make_frame
from hdbench.diagnosis.planning.proposal import effects_named
from hdbench.diagnosis.planning.segments import (
    LoadStep,
    MotionPlan,
    Segment,
    planned_motion,
    planned_trace,
)
from hdbench.model import Motion, catalogue, motion_from_trace
from hdbench.plant.servo import command_rad_s, servo_loop
from hdbench.profile import load_profile
from hdbench.records.trace import Trace

PROFILE = load_profile("cim-tr-97-06").data
PERIOD_S = 0.001


def motion_at(speeds: tuple[float, ...], each_s: float) -> Motion:
    """Return a motion that changes from one steady speed to the next within 50 ms."""
    smooth = np.hanning(50) / np.hanning(50).sum()
    velocity = np.repeat(speeds, round(each_s / PERIOD_S))
    padded = np.pad(velocity, 50, mode="edge")
    velocity = np.convolve(padded, smooth, mode="same")[50:-50]
    time = PERIOD_S * np.arange(len(velocity))
    angle = np.concatenate([[0.0], np.cumsum(0.5 * PERIOD_S * (velocity[1:] + velocity[:-1]))])
    columns = {"time_s": time, "motor_velocity_rad_s": velocity, "motor_angle_rad": angle}
    return motion_from_trace(Trace(columns, "two speeds"), PROFILE)


def compared(motion, *names, **more):
    return compare(motion, effects_named(names), PROFILE, **more)


def test_a_tone_imitates_a_quarter_of_an_order_at_two_speeds():
    # a tone fits one of two equally long speeds and is orthogonal to the other, with half of its
    # own power at each: cos^2 = (n / 4)^2 / (n / 2)^2 = 1/4. What it picks up of the other speed,
    # and the changes of speed, are below 1 %; a sketch adds 1 %
    names = ("ripple-harmonic", "structural-tone")
    found = compared(motion_at((100.0, 170.0), 15.0), *names)
    assert found.share(*names) == pytest.approx(0.75, abs=0.02)


def test_eccentricity_and_unbalance_at_two_speeds_have_the_closed_form_share():
    # amplitudes (1, 1) and (1, 9) at speeds w and 3 w, equally long:
    # sin^2 = 1 - (1 + 9)^2 / (2 (1 + 81)) = 0.390
    names = ("wave-generator-eccentricity", "motor-unbalance")
    found = compared(motion_at((60.0, 180.0), 15.0), *names)
    for pair in (names, names[::-1]):
        assert found.share(*pair) == pytest.approx(1.0 - 100.0 / 164.0, abs=0.015)


def test_the_bound_of_a_tone_is_that_of_the_literature():
    # sigma_A = sigma sqrt(2 / n) = 2.9e-4 N m for 60 s of 0.05 N m at 1 kHz
    found = compared(motion_at((156.0,), 60.0), "structural-tone")
    (entry,) = found.visibility
    assert entry.std_nm == pytest.approx(0.05 * math.sqrt(2.0 / 60_000), rel=0.02)
    assert entry.detectable_nm is not None
    # 5.5 standard deviations to be found among all frequencies, and 1.28 for 90 %
    assert entry.detectable_nm / entry.std_nm == pytest.approx(5.5 + 1.28, abs=0.6)


def test_red_noise_hides_slow_effects_by_its_spectrum_at_zero():
    # an AR(1) of 0.9 has 1 / (1 - 0.9) = 10 times the innovation's density (in amplitude) at 0 Hz
    motion = motion_at((50.0, -50.0), 10.0)
    white = compared(motion, "zero-drift", noise=Noise.white(0.01)).visibility[0]
    phase = np.linspace(0.0, np.pi, 513)
    power = 0.01**2 / np.abs(1.0 - 0.9 * np.exp(-1j * phase)) ** 2
    noise = Noise(phase / (2.0 * np.pi * PERIOD_S), power)
    red = compared(motion, "zero-drift", noise=noise).visibility[0]
    assert red.std_nm / white.std_nm == pytest.approx(10.0, rel=0.05)


def test_a_sketch_gives_the_shares_of_all_samples():
    names = (
        "motor-unbalance", "wave-generator-eccentricity", "coulomb-friction", "viscous-friction",
        "zero-drift", "angular-misalignment", "inertia-error",
    )  # fmt: skip
    motion = planned_motion(full_protocol(PROFILE, loads=False), PROFILE)
    few, whole = compared(motion, *names), compared(motion, *names, n_rows=len(motion))
    # the error that the frame states for itself
    assert np.nanmax(np.abs(few.sin2 - whole.sin2)) < 0.02


def swept():
    sweep = (Segment("ramp", 8.0, 150.0), Segment("ramp", 8.0, -150.0), Segment("ramp", 4.0, 0.0))
    return planned_motion(MotionPlan("sweep", sweep), PROFILE)


def test_what_remembers_is_the_same_on_few_samples_as_on_all():
    motion = swept()
    frame = make_frame(motion, PROFILE, Noise.white(0.05), n_rows=2000)
    assert len(frame.course) < 0.3 * len(motion)
    for name, shape in (
        ("torsional-resonance", {"resonance_hz": 12.0, "damping": 0.03}),
        ("presliding", {"presliding_angle_rad": 0.1}),
        ("time-skew", {"delay_s": 0.002}),
    ):
        cause = catalogue()[name]
        named = {p.name: shape.get(p.name, 0.1) for p in cause.shape}
        quick = frame.white(cause, named).T
        exact = cause.columns(frame.motion, named)[frame.rows] * (frame.weights / 0.05)[:, None]
        # the agreement that the frame asks for before it leaves samples out
        assert np.linalg.norm(quick - exact) <= 3e-3 * np.linalg.norm(exact), name


def test_in_a_flat_spectrum_shares_are_those_of_white_noise():
    motion = swept()
    names = ("coulomb-friction", "viscous-friction", "zero-drift", "zero-step")
    # flat but for a corner where none of them has power: all samples are transformed
    steep = Noise(np.array([0.0, 490.0, 500.0]), np.array([1e-4, 1e-4, 2.5e-4]))
    assert not steep.is_white
    found = compared(motion, *names, noise=steep)
    white = compared(motion, *names, noise=Noise.white(0.01), n_rows=len(motion))
    # the transform fades a hundredth of the record out at either end
    assert np.nanmax(np.abs(found.sin2 - white.sin2)) < 0.05
    for one, other in zip(found.visibility, white.visibility, strict=True):
        assert one.std_nm == pytest.approx(other.std_nm, rel=0.05)


def test_gravity_and_misalignment_are_alike_on_every_motion():
    motion = planned_motion(full_protocol(PROFILE, loads=False), PROFILE)
    found = compared(motion, "misalignment", "load-gravity")
    assert found.inseparable() == (("misalignment", "load-gravity"),)


def test_what_a_motion_cannot_show_is_told_with_its_reason():
    found = compared(motion_at((156.0,), 5.0), "gain-ripple", "coulomb-friction", "spikes")
    reasons = {entry.name: entry.reason for entry in found.visibility}
    assert "load" in reasons["gain-ripple"]
    assert re.search("one direction|baseline", reasons["coulomb-friction"])
    assert re.search("looks of (its|their) own", reasons["spikes"])
    assert found.share("gain-ripple", "coulomb-friction") is None


@pytest.mark.parametrize(
    ("steps", "speed_rad_s", "angle_rad"),
    [
        # both solve the same servo in closed form; the acceleration limit is never reached here
        (next(b for b in blocks(PROFILE) if b.name == "staircase").steps, 1e-9, 1e-7),
        # the sample in which the limit is left is solved to within its own length
        ((Segment("ramp", 0.01, 300.0), Segment("hold", 1.0, 300.0)), 0.1, 0.02),
    ],
    ids=["staircase", "a jump beyond the acceleration limit"],
)
def test_a_planned_motion_is_that_of_the_emulated_servo(steps, speed_rad_s, angle_rad):
    trace = planned_trace(MotionPlan("planned", steps), PROFILE)
    command = command_rad_s(PROFILE, trace["reference_v"])
    run = servo_loop(PROFILE.servo).run(command, PERIOD_S, 1, (0.0, 0.0, 0.0))
    found = trace["motor_velocity_rad_s"], trace["motor_angle_rad"]
    np.testing.assert_allclose(found[0], run.velocity_rad_s[:, 0], atol=speed_rad_s)
    np.testing.assert_allclose(found[1], run.angle_rad[:, 0], atol=angle_rad)


def test_loads_stand_in_the_planned_record_and_locked_ones_do_not_move():
    steps = (
        LoadStep("hang 5 N m", 5.0, locked=True, position_rad=1.5),
        Segment("rest", 1.0),
        LoadStep("take it off", 0.0),
        Segment("ramp", 1.0, 50.0),
        Segment("ramp", 1.0, 0.0),
    )
    trace = planned_trace(MotionPlan("loads", steps), PROFILE)
    locked = trace["load_torque_nm"] == 5.0
    assert int(locked.sum()) == 1000
    np.testing.assert_array_equal(trace["output_angle_rad"][locked], 1.5)
    assert trace.time_s[1000] - trace.time_s[999] > 10.0
    assert trace["motor_velocity_rad_s"][~locked].max() == pytest.approx(50.0, rel=0.05)
