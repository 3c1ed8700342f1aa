"""Testable names of a record: by its motion, its torque's bandwidth and its channels."""

from dataclasses import replace

import numpy as np
import pytest

from hdbench.diagnosis.answer import testable as room
from hdbench.model import Motion, catalogue

RATE_HZ = 500.0
WHOLE = room.TorqueChannel(np.inf, RATE_HZ, step_nm=0.0, noise_nm=0.05, held_share=0.0)


def motion(seconds: float = 40.0) -> Motion:
    """Return a loaded motion of both directions at 20 to 100 rad/s."""
    time = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    wave = 2.0 * np.pi * time / 10.0
    velocity = 100.0 * np.sin(wave)
    angle = 100.0 * 10.0 / (2.0 * np.pi) * (1.0 - np.cos(wave))
    return Motion(
        time,
        velocity,
        angle,
        np.gradient(velocity, time),
        angle / 10.0,
        np.ones(len(time), dtype=bool),
        "motor_angle_rad",
        100.0,
        load_torque_nm=10.0 * np.sin(0.3 * wave),
        motor_current_a=np.sin(wave),
        inertia_nm_s2=0.01,
        simulated_nm=0.4 * np.cos(2.0 * angle),
    )


def told(where: Motion, **changed: object) -> dict[str, tuple[bool, str]]:
    """Return what is said of each name."""
    derived = changed.pop("derived", ())
    answer = room.testable(catalogue().values(), where, replace(WHOLE, **changed), derived)
    return {one.name: (one.testable, one.because) for one in answer}


def test_every_name_is_told_and_a_rich_record_shows_all_of_them():
    answer = told(motion())
    assert list(answer) == list(catalogue())
    # an error of the angle shows in the slope of a simulated ripple, which this motion lacks, and
    # a bearing's order needs a hundred turns
    hidden = {name for name, (seen, _) in answer.items() if not seen}
    assert hidden == {"transmission-error", "bearing-defect"}
    assert "turns; needed: 100" in answer["bearing-defect"][1]


def test_a_low_pass_hides_what_stands_above_it():
    answer = told(motion(), low_pass_hz=5.0)
    hidden = {name for name, (seen, _) in answer.items() if not seen}
    assert hidden >= {"mains-hum", "tooth-mesh", "spikes", "quantisation", "speed-dependent-noise"}
    assert not hidden & {"viscous-friction", "coulomb-friction", "zero-drift", "misalignment"}
    assert answer["mains-hum"][1].startswith("torque low-passed at 5 Hz; ")
    # a place that is free is seen where it stands low enough, and the answer says so
    assert answer["structural-tone"] == (
        True,
        "torque low-passed at 5 Hz; what stands above is not seen",
    )


@pytest.mark.parametrize("bandwidth_hz", [5.0, 25.0, 100.0])
def test_a_line_far_above_the_samples_is_not_taken_for_its_alias(bandwidth_hz):
    # order 202 at 1 turn/s more than a multiple of the rate: its alias stands at 2 Hz
    speed = 2.0 * np.pi * (RATE_HZ + 2.0) / 202.0
    time = motion().time_s
    steady = replace(
        motion(),
        velocity_rad_s=np.full(len(time), speed),
        angle_rad=speed * time,
        acceleration_rad_s2=np.zeros(len(time)),
    )
    assert not told(steady, low_pass_hz=bandwidth_hz)["tooth-mesh"][0]


def test_seen_steps_are_quantisation_at_any_bandwidth_and_hide_fine_noise():
    answer = told(motion(), low_pass_hz=5.0, step_nm=0.5)
    assert answer["quantisation"][0]
    answer = told(motion(), step_nm=0.5)
    assert "steps of 0.5 N m" in answer["speed-dependent-noise"][1]


def test_ripple_that_is_faster_than_the_samples_looks_like_noise():
    seen, why = told(motion(), rate_hz=30.0)["speed-dependent-noise"]
    assert not seen
    # nine samples in ten are slower than 98.8 rad/s
    assert why.startswith("the motor turns 0.52 times between two samples; needed: less than 0.25")


def test_held_samples_end_the_band_of_the_torque():
    seen, why = told(motion(), held_share=0.9)["mains-hum"]
    assert not seen
    assert why.startswith("90 % of the torque samples are held, it ends at 25 Hz")


def test_one_channel_accuses_nobody():
    pair = (("motor_velocity_rad_s", "motor_angle_rad"),)
    answer = told(motion(), derived=pair)
    assert not answer["tacho-ripple"][0]
    # the phase of the ripple tells these, where the torque shows it
    assert answer["encoder-slip"][0]
    answer = told(motion(), derived=pair, low_pass_hz=0.2)
    assert not answer["encoder-slip"][0]


def test_what_never_changes_is_a_zero():
    steady = replace(motion(), load_torque_nm=np.full(len(motion()), 10.0), inertia_nm_s2=0.0)
    seen, why = told(steady)["side-force"]
    assert not seen
    assert "same all along" in why


def test_a_long_record_is_judged_from_stretches_of_it():
    long, short = motion(400.0), motion(40.0)
    assert {k: v[0] for k, v in told(long, low_pass_hz=20.0).items()} == {
        k: v[0] for k, v in told(short, low_pass_hz=20.0).items()
    }


def test_a_table_of_readings_is_judged_too():
    few = motion(8 / RATE_HZ)
    standing = replace(few, velocity_rad_s=np.zeros(8), load_torque_nm=np.linspace(-20.0, 20.0, 8))
    answer = told(standing)
    assert answer["cubic-nonlinearity"][0]
    assert not answer["viscous-friction"][0]
