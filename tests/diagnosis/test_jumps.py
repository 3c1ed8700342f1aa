"""An acceleration that jumps, and a loop beside an error of the gain."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter
from swinging_shaft import trace_of

from hdbench.diagnosis import diagnose_trace
from hdbench.model import catalogue, motion_from_trace
from hdbench.profile import load_profile

PROFILE = load_profile("cim-tr-97-06")
NOISE_NM = 0.02
RATE_HZ = 1000.0
# a servo that follows its ramp within some milliseconds
LAG_S = 0.004


def stepped(seed):
    """Record of ramps between speeds of both signs."""
    rng = np.random.default_rng(seed)
    speeds = [0.0, 60.0, 120.0, 40.0, -40.0, -120.0, -60.0, 0.0, 90.0, -90.0, 0.0]
    wanted = np.concatenate(
        [np.concatenate([np.linspace(a, b, 300), np.full(1200, b)]) for a, b in pairwise(speeds)]
    )
    pole = np.exp(-1.0 / (RATE_HZ * LAG_S))
    speed = lfilter([0.0, 1.0 - pole], [1.0, -pole], wanted)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) / RATE_HZ])
    data = PROFILE.data
    inertia = data.drive.load_inertia_kg_m2 / data.drive.gear_ratio
    expected = inertia * np.gradient(speed) * RATE_HZ
    torque = expected + 0.3 * np.cos(2.0 * angle) + NOISE_NM * rng.standard_normal(len(speed))
    return trace_of(np.arange(len(speed)) / RATE_HZ, speed, angle, torque)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [2, 3])
def test_jumps_alone_are_no_finding(seed):
    assert diagnose_trace(stepped(seed), PROFILE, materiality=0.0).verdict == "nothing-found"


def test_the_gain_of_a_loop_is_no_more_than_its_chord():
    cause = catalogue()["hysteresis"]
    time = np.arange(4000) / RATE_HZ
    load = 20.0 * np.sin(2.0 * np.pi * 0.5 * time)
    still = np.zeros(len(time))
    trace = trace_of(time, still, still, load, load_torque_nm=load)
    motion = motion_from_trace(trace, PROFILE.data)
    assert cause.possible is not None
    shape = {"yield_nm": 5.0}
    loop = cause.columns(motion, shape) @ cause.possible(motion, shape)
    top = int(np.argmax(load))
    # on first loading the loop less its whole chord begins and ends at zero
    assert abs(loop[0, 1]) < 1e-4 * loop[top, 0]
    assert abs(loop[top, 1]) < 1e-3 * loop[top, 0]
