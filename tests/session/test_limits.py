"""Limits and stuck channels are watched in every sample; what cannot be seen counts as crossed."""

import math

import numpy as np
import pytest
from fakes import WHOLE

from hdbench.devices.bench import Block
from hdbench.errors import DeviceError
from hdbench.session.limits import HeldTorque, LimitWatch, SpeedWatch
from hdbench.session.stop import Aborted

LIMITS = WHOLE.data.limits


def block(n=4, lost=0, first=100, absent=()):
    zero = np.zeros(n)
    return Block(
        first, lost, zero, zero, zero, zero, zero.astype(np.int64), np.zeros(n, dtype=bool),
        running=True, watchdog_tripped=False, depth=0, absent=absent,
    )  # fmt: skip


def rows(n=4, lost=0, **changes):
    base = {
        name: np.concatenate((np.full(lost, np.nan), np.zeros(n)))
        for name in ("motor_velocity_rad_s", "torque_nm", "motor_current_a", "motor_angle_rad")
    }
    for name, (index, value) in changes.items():
        base[name][lost + index] = value
    return base


@pytest.mark.parametrize(
    ("column", "limit", "word"),
    [
        ("motor_velocity_rad_s", LIMITS.velocity_rad_s, "motor speed"),
        ("torque_nm", LIMITS.torque_nm, "torque"),
        ("motor_current_a", LIMITS.current_a, "motor current"),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_crossing_names_channel_limit_and_sample(column, limit, word, sign):
    LimitWatch(LIMITS).check(block(), rows(**{column: (2, sign * limit)}))
    with pytest.raises(Aborted, match=f"{word}.* crossed the limit {limit:g}") as error:
        LimitWatch(LIMITS).check(block(lost=3), rows(lost=3, **{column: (2, 1.01 * sign * limit)}))
    assert error.value.where == "sample 102"


def test_lost_samples_cross_nothing_but_a_measured_nan_does():
    LimitWatch(LIMITS).check(block(lost=5), rows(lost=5))
    with pytest.raises(Aborted, match="motor speed"):
        LimitWatch(LIMITS).check(block(), rows(motor_velocity_rad_s=(0, math.nan)))


def test_a_channel_that_the_bench_does_not_have_is_not_watched():
    unknown = {**rows(), "motor_current_a": np.full(4, np.nan)}
    LimitWatch(LIMITS).check(block(absent=("current",)), unknown)


def test_travel_counts_from_where_the_acquisition_began():
    watch = LimitWatch(LIMITS.model_copy(update={"travel_rad": 10.0}))
    start = rows()
    start["motor_angle_rad"] += 500.0
    watch.check(block(), start)
    on = rows(motor_angle_rad=(1, 0.0))
    on["motor_angle_rad"] += 491.0
    watch.check(block(first=104), on)
    on["motor_angle_rad"] -= 2.0
    with pytest.raises(Aborted, match=r"travel -11 rad crossed the limit 10 rad"):
        watch.check(block(first=108), on)


PERIOD_S = 1e-3


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
            watch.check(block(len(angle[part]), lost, first), rows)
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


@pytest.mark.parametrize(
    ("angle", "speed"),
    [
        (np.zeros(2000), np.zeros(2000)),  # a motor that stands
        (np.zeros(2000), np.full(2000, 5.0)),  # zero error of the tacho: 90 mV of 10 V
        (np.arange(1.0, 3001.0) * 30.0 * PERIOD_S, np.full(3000, 30.0)),  # no noise at all
    ],
)
def test_what_stands_still_together_is_no_fault(angle, speed):
    assert run(angle, speed) is None


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
