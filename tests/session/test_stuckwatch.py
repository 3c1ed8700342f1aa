"""A channel that holds one value while another one says that the motor turns."""

import numpy as np
import pytest

from hdbench.devices.bench import Block
from hdbench.errors import DeviceError
from hdbench.session.limits import HeldTorque, SpeedWatch

PERIOD_S = 1e-3


def block(first, n, lost=0):
    zero = np.zeros(n)
    return Block(
        first, lost, zero, zero, zero, zero, zero.astype(np.int64), np.zeros(n, dtype=bool),
        running=True, watchdog_tripped=False, depth=0,
    )  # fmt: skip


def run(angle, speed, *, size=22, lost=0):
    """Feed a record to a watch in blocks; return the sample before which it raised, or None."""
    watch = SpeedWatch(PERIOD_S, 562.0)
    for first in range(0, len(angle), size):
        part = slice(first, first + size)
        nan = np.full(lost, np.nan)
        rows = {
            "motor_angle_rad": np.concatenate((nan, angle[part])),
            "motor_velocity_rad_s": np.concatenate((nan, speed[part])),
        }
        try:
            watch.check(block(first, len(angle[part]), lost), rows)
        except DeviceError:
            return first + len(angle[part])
    return None


def motion(seconds, seed=0):
    """A sine of 50 rad/s as encoder counts and as a noisy, 12-bit tacho."""
    t = np.arange(round(seconds / PERIOD_S)) * PERIOD_S
    speed = 50.0 * np.sin(2.0 * np.pi * 0.5 * t)
    angle = np.round(np.cumsum(speed) * PERIOD_S * 4000 / (2.0 * np.pi)) * 2.0 * np.pi / 4000
    noise = np.random.default_rng(seed).normal(0.0, 0.2, len(t))
    return angle, np.round((speed + noise) / 0.27) * 0.27


@pytest.mark.parametrize("start", range(150, 700, 37))
@pytest.mark.parametrize("channel", ["tacho", "encoder"])
def test_a_speed_that_stands_still_for_200_ms_is_found_wherever_it_begins(start, channel):
    angle, speed = motion(2.0)
    values = speed if channel == "tacho" else angle
    # stuck at a value of long before, as a broken cable or a dead counter leaves it
    values[start:] = values[20]
    found = run(angle, speed)
    assert found is not None
    assert start < found <= start + 200 + 22


def test_a_motion_of_ten_minutes_is_no_fault():
    angle, speed = motion(600.0)
    assert run(angle, speed, size=100) is None


def test_a_motor_that_stands_is_no_fault():
    assert run(np.zeros(2000), np.zeros(2000)) is None


def test_a_zero_error_of_the_tacho_at_standstill_is_no_fault():
    # 5 rad/s are 90 mV of a channel of 10 V
    assert run(np.zeros(2000), np.full(2000, 5.0)) is None


def test_a_constant_speed_without_noise_is_no_fault():
    speed = np.full(3000, 30.0)
    assert run(np.cumsum(speed) * PERIOD_S, speed) is None


def test_lost_samples_are_not_taken_for_motion():
    angle, speed = motion(1.0)
    assert run(angle, speed, lost=3) is None


def held(torque, angle, size):
    count = HeldTorque(PERIOD_S)
    return sum(
        count.count(torque[k : k + size], angle[k : k + size]) for k in range(0, len(torque), size)
    )


@pytest.mark.parametrize("size", [1, 7, 22, 500, 4000])
def test_a_torque_that_holds_while_the_motor_turns_is_counted_to_the_sample(size):
    angle = np.arange(3000) * PERIOD_S * 50.0
    torque = np.random.default_rng(1).normal(size=3000)
    assert held(torque, angle, size) == 0
    torque[1001:1401] = torque[1000]
    assert held(torque, angle, size) == 401


def test_a_short_flat_line_and_one_at_standstill_are_not_counted():
    angle = np.arange(3000) * PERIOD_S * 50.0
    torque = np.random.default_rng(1).normal(size=3000)
    torque[1001:1150] = torque[1000]
    assert held(torque, angle, 22) == 0
    torque[:] = 0.0
    assert held(torque, np.zeros(3000), 22) == 0
    # half a turn in all is needed
    assert held(torque, np.linspace(0.0, 3.1, 3000), 22) == 0


def test_lost_samples_end_a_flat_line():
    angle = np.arange(1000) * PERIOD_S * 50.0
    torque = np.zeros(1000)
    torque[::150] = np.nan
    assert held(torque, angle, 22) == 0
