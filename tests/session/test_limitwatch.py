"""Limits are held against every sample that was measured; what cannot be seen counts as crossed."""

import math

import numpy as np
import pytest

from hdbench.devices.bench import Block
from hdbench.profile import load_profile
from hdbench.session.limits import LimitWatch
from hdbench.session.stop import Aborted

LIMITS = load_profile("cim-tr-97-06").data.limits


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
    changed = rows()
    changed["motor_current_a"][:] = np.nan
    LimitWatch(LIMITS).check(block(absent=("current",)), changed)


def test_travel_counts_from_where_the_acquisition_began():
    limits = LIMITS.model_copy(update={"travel_rad": 10.0})
    watch = LimitWatch(limits)
    start = rows()
    start["motor_angle_rad"] += 500.0
    watch.check(block(), start)
    on = rows(motor_angle_rad=(1, 0.0))
    on["motor_angle_rad"] += 491.0
    watch.check(block(first=104), on)
    on["motor_angle_rad"] -= 2.0
    with pytest.raises(Aborted, match=r"travel -11 rad crossed the limit 10 rad"):
        watch.check(block(first=108), on)
