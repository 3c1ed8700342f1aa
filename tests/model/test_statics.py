"""Readings as a standing motion, checked by hand."""

import numpy as np
import pytest

from hdbench.errors import DataError
from hdbench.model import statics
from hdbench.profile import load_profile
from hdbench.records import LoadReading, Loads

PROFILE = load_profile("cim-tr-97-06").data


def loads(rows, **more):
    """Rows of experiment, torque, time."""
    return Loads(
        tuple(
            LoadReading(name, 0.5, "full", "cw", "up", torque, torque / 6.6, time_s=time, **more)
            for name, torque, time in rows
        )
    )


def test_readings_stand_still_under_their_loads():
    rows = [("a", 0.0, 0.0), ("a", 9.0, 30.0), ("b", 1.0, 90.0)]
    motion = statics.motion_from_loads(loads(rows), PROFILE)
    assert motion.load_torque_nm.tolist() == [0.0, 9.0, 1.0]
    assert motion.applied_nm.tolist() == [0.0, 9.0, 1.0]
    assert not motion.velocity_rad_s.any()
    assert not motion.acceleration_rad_s2.any()
    assert motion.output_angle_rad.tolist() == [0.5, 0.5, 0.5]
    assert motion.angle_rad.tolist() == [50.0, 50.0, 50.0]
    assert motion.starts.tolist() == [True, False, True]
    assert motion.time_s.tolist() == [0.0, 30.0, 90.0]
    assert motion.temperature_c is None
    warm = statics.motion_from_loads(loads(rows, temperature_c=21.5), PROFILE)
    assert warm.temperature_c.tolist() == [21.5, 21.5, 21.5]


@pytest.mark.parametrize(
    ("times", "expected", "measured"),
    [
        ([0.0, 30.0, 60.0, 95.0], [0.0, 30.0, 60.0, 95.0], True),
        # the clock starts again with the second experiment: it goes on one median step later
        ([0.0, 30.0, 0.0, 31.0], [0.0, 30.0, 60.5, 91.5], True),
        ([0.0, None, 60.0, 95.0], [0.0, 1.0, 2.0, 3.0], False),
        ([0.0, 0.0, 60.0, 95.0], [0.0, 1.0, 2.0, 3.0], False),
    ],
)
def test_times_that_cannot_be_are_replaced_by_numbers(times, expected, measured):
    names = ["a", "a", "b", "b"]
    found, given = statics.reading_times(
        loads(list(zip(names, [0.0, 1.0, 2.0, 3.0], times, strict=True)))
    )
    assert found.tolist() == expected
    assert given is measured


def test_experiments_are_numbered_as_they_appear():
    rows = [("x", 0.0, None), ("b", 0.0, None), ("x", 1.0, None)]
    assert statics.experiment_numbers(loads(rows)).tolist() == [0, 1, 0]


def test_a_preload_goes_to_the_furthest_load_and_back():
    rows = [("a", 1.0, 0.0), ("a", 8.0, 1.0), ("a", 2.0, 2.0), ("b", 0.0, 3.0), ("b", -5.0, 4.0)]
    longer, readings = statics.preloaded_motion(statics.motion_from_loads(loads(rows), PROFILE))
    assert longer.load_torque_nm.tolist() == [1, 8, 1, 1, 8, 2, 0, -5, 0, 0, -5]
    assert readings.tolist() == [3, 4, 5, 9, 10]
    assert np.flatnonzero(longer.starts).tolist() == [0, 6]


def test_no_readings_and_no_number_are_told():
    with pytest.raises(DataError, match="found 0 readings"):
        statics.motion_from_loads(Loads(()), PROFILE)
    with pytest.raises(DataError, match=r"reading 2 has torque nan N m"):
        statics.motion_from_loads(loads([("a", 0.0, 0.0), ("a", float("nan"), 1.0)]), PROFILE)
