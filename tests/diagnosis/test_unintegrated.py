"""A velocity formed over a late stamp is no slip of the encoder."""

from __future__ import annotations

import numpy as np
import pytest

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.acquisition.channels import shaft_of
from hdbench.diagnosis.acquisition.integration import unintegrated_rad
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
PERIOD_S = 5e-3


def trace(late: tuple[int, ...] = (), late_s: float = 2e-3, seed: int = 0) -> Trace:
    """Return 60 s of an uneven speed whose velocity is the difference of angles over the stamps.

    At the samples `late` the stamp is late, the angle is not: the velocity of that interval comes
    out too small and that of the next one too large.
    """
    time = np.arange(12_000) * PERIOD_S
    rate = 2.0 * np.pi / 7.0
    angle = 60.0 * time + 30.0 / rate * (1.0 - np.cos(rate * time))
    stamps = time.copy()
    stamps[list(late)] += late_s
    velocity = np.gradient(angle, time)
    for at in late:
        velocity[at] = (angle[at] - angle[at - 1]) / (stamps[at] - stamps[at - 1])
        velocity[at + 1] = (angle[at + 1] - angle[at]) / (stamps[at + 1] - stamps[at])
    torque = 0.4 * np.cos(2.0 * angle) + 0.2 * np.cos(4.0 * angle)
    torque += 0.05 * np.random.default_rng(seed).standard_normal(time.size)
    names = ("time_s", "motor_velocity_rad_s", "motor_angle_rad", "torque_nm")
    return Trace(dict(zip(names, (time, velocity, angle, torque), strict=True)))


def test_a_velocity_that_keeps_its_course_leaves_next_to_nothing_open() -> None:
    smooth = unintegrated_rad(shaft_of(trace(), PROFILE.data))
    late = unintegrated_rad(shaft_of(trace(late=(4000,)), PROFILE.data))
    # the turning points of a smooth speed leave the median of their neighbours, by its curvature
    assert smooth.max() < 1e-3 * late.max()
    # velocities 4000 and 4001 are wrong; the median of five reaches two further, to 3998 and 4003,
    # whose increments end at 3997 and 4003, each told to one neighbour too
    assert np.flatnonzero(late > 1e-3 * late.max()).tolist() == list(range(3996, 4005))


def test_what_a_late_stamp_leaves_open_covers_the_rules_own_error() -> None:
    shaft = shaft_of(trace(late=(4000,)), PROFILE.data)
    wrong = np.abs(shaft.by_encoder_rad - shaft.by_tacho_rad)
    around = slice(3998, 4003)
    usual = wrong[:3990].max()
    assert wrong[around].max() > 10.0 * usual
    assert np.all(unintegrated_rad(shaft)[around] + 2.0 * usual >= wrong[around])


@pytest.mark.parametrize("late", [(4000,), (2000, 5000, 8000)])
def test_late_stamps_are_not_called_slips(late: tuple[int, ...]) -> None:
    result = diagnose_trace(trace(late), PROFILE)
    assert "encoder-slip" not in {cause.name for cause in (*result.causes, *result.minor)}
    assert "encoder-slip" not in {flag.name for flag in result.data_flags}
