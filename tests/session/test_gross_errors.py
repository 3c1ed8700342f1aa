"""A wrong weight is noticed, and the weight that would explain it is named."""

import math

import pytest
from fakes import WHOLE

from hdbench.session.calibrating.plan import calibration_points
from hdbench.session.calibrating.plausibility import (
    Expectation,
    gross_error,
    learnt_gain,
    weights_of,
)

PROFILE = WHOLE.data
LEVER = 9.80650 * 0.5  # N m per kg
GAIN = 6.6
WEIGHTS = weights_of(calibration_points(PROFILE))
UNEXPLAINED = "no weight of the set explains it"


def point(experiment: str, mass_kg: float):
    asked = (experiment, mass_kg)
    return next(p for p in calibration_points(PROFILE) if (p.experiment, p.mass_kg) == asked)


def error(asked, hung_nm: float, *, zero_v: float = 0.1, gain: float = GAIN, accepted=()):
    expectation = Expectation(zero_v, learnt_gain(accepted, GAIN))
    read_nm = expectation.torque_nm(zero_v + hung_nm / gain)
    return gross_error(asked, read_nm, 0.3, WEIGHTS, PROFILE.arm)


def test_the_wrong_side_is_named():
    wrong_side = error(point("p1-ccw-full", 4.0), 4.0 * LEVER)
    assert "did you hang 4 kg on the cw side?" in wrong_side


@pytest.mark.parametrize("hung_nm", [3.25 * LEVER, math.nan])
def test_what_no_weight_explains_is_said_so(hung_nm):
    assert UNEXPLAINED in error(point("p1-cw-full", 4.0), hung_nm)


@pytest.mark.parametrize("experiment", ["p1-cw-low", "p1-ccw-full"])
def test_every_pair_of_weights_of_a_series_is_told_apart_and_the_right_one_passes(experiment):
    series = [p for p in calibration_points(PROFILE) if p.experiment == experiment]
    for asked in series:
        assert error(asked, asked.torque_nm) is None
        for other in series:
            if other.mass_kg != asked.mass_kg:
                found = error(asked, other.torque_nm)
                hung = f"did you hang {other.mass_kg:g} kg?"
                assert (hung if other.mass_kg else "does no weight hang?") in found


def test_a_gain_off_by_seven_percent_is_no_wrong_weight_but_ten_kept_readings_teach_more():
    heavy = point("p1-cw-full", 8.0)
    assert error(heavy, heavy.torque_nm, gain=1.07 * GAIN) is None
    true_gain = 1.25 * GAIN
    assert error(heavy, heavy.torque_nm, gain=true_gain) is not None
    kept = [(mass * LEVER, mass * LEVER / true_gain) for mass in (2.0, 4.0, 6.0)]
    assert error(heavy, heavy.torque_nm, gain=true_gain, accepted=kept) is None


def test_one_wrong_reading_among_those_kept_does_not_move_what_is_expected():
    kept = [(mass * LEVER, mass * LEVER / GAIN) for mass in (2.0, 4.0)]
    kept.append((6.0 * LEVER, 2.0 * LEVER / GAIN))
    assert learnt_gain(kept, GAIN) == pytest.approx(GAIN)
