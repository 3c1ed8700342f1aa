"""Limits and loops on calibration loads as an outsider writes them: one cause each, one name."""

from itertools import product

import numpy as np
import pytest
from load_readings import simulate_loads

from hdbench.diagnosis.static import diagnose_loads
from hdbench.model import catalogue
from hdbench.model.statics import motion_from_loads
from hdbench.profile import load_profile
from hdbench.records import LoadReading, Loads

PROFILE = load_profile("cim-tr-97-06")
GAIN = 6.6
NOISE_NM = 0.004
MASSES = np.arange(9.0)
TORQUE = MASSES * 9.8065 * 0.5
TOP = float(TORQUE[-1])


def plain(torque, _falling):
    return torque


def loads(signal=plain, *, limit=np.inf, positions=4, interval_s=60.0, seed=1):
    """Readings of loads up and down; `signal(torque, falling)` is what the channel is given."""
    rng = np.random.default_rng([97, seed])
    readings = []
    for place, way in product(range(positions), ("cw", "ccw")):
        zero = 0.02 * rng.standard_normal()
        for series, torques in (("up", TORQUE), ("down", TORQUE[::-1])):
            torques = torques if way == "cw" else -torques
            given = signal(torques, series == "down") + zero
            noise = NOISE_NM * rng.standard_normal(len(torques))
            volts = (np.clip(given, -limit, limit) + noise) / GAIN
            for torque, reading in zip(torques.tolist(), volts.tolist(), strict=True):
                reading = LoadReading(
                    f"{place}{way}", 2.0 * np.pi * place / positions + 0.2, "full", way, series,
                    torque, reading, time_s=interval_s * (len(readings) + 1),
                )  # fmt: skip
                readings.append(reading)
    return Loads(tuple(readings), source="readings of the test")


def one_cause(found):
    assert found.verdict == "named"
    assert found.unexplained == ()
    (cause,) = found.causes
    return cause


def misfit_nm(model, readings):
    """Return the rms by which the model misses readings."""
    again = simulate_loads(model, readings, PROFILE.data)
    pairs = zip(again.readings, readings.readings, strict=True)
    return GAIN * np.sqrt(
        np.mean([(made.reading_v - given.reading_v) ** 2 for made, given in pairs])
    )


@pytest.mark.parametrize("limit", [30.0, pytest.param(33.0, marks=pytest.mark.campaign)])
def test_readings_that_are_cut_off_are_a_saturation_and_nothing_else(limit):
    readings = loads(limit=limit)
    found = diagnose_loads(readings, PROFILE)
    cause = one_cause(found)
    assert cause.name == "saturation"
    assert misfit_nm(found.model, readings) < 1.5 * NOISE_NM
    # 32 or 48 readings stand at the limit: noise of 4 mN m leaves 1 mN m, and the gain as much
    assert abs(cause.parameters["limit_nm"].value - limit) < 0.02
    assert abs(cause.parameters["share"].value - 1.0) < 0.02


def test_the_sharpest_limit_of_the_catalogue_is_a_clip():
    limiter = catalogue()["saturation"]
    motion = motion_from_loads(loads(), PROFILE.data)
    torque = motion.applied_nm
    made = torque + limiter.columns(motion, {"limit_nm": 33.0, "sharpness": 64.0})[:, 0]
    # the loads nearest to the limit stand 4 % above it, where tanh(x^64)^(1/64) is 1 - 1e-9
    assert np.abs(made - np.clip(torque, -33.0, 33.0)).max() < 1e-6
    far = torque + limiter.columns(motion, {"limit_nm": 3e5, "sharpness": 64.0})[:, 0]
    # a power that underflows takes nothing
    assert np.array_equal(far, torque)


def branches(width, rising, falling):
    def signal(torque, down):
        size = np.abs(torque) / TOP
        lens = 4.0 * size * (1.0 - size)
        return torque + np.sign(torque) * width * lens * (falling if down else rising)

    return signal


@pytest.mark.parametrize(
    ("rising", "falling"),
    [(0.0, 1.0), (1.0, 0.0), (-0.5, 0.5)],
    ids=["loading straight", "unloading straight", "both bent"],
)
def test_a_loop_is_one_cause_on_whichever_side_of_the_gain_it_lies(rising, falling):
    cause = one_cause(diagnose_loads(loads(branches(0.25, rising, falling), positions=2), PROFILE))
    assert cause.name == "hysteresis"


def test_a_sagging_arm_beside_a_loop_stays_a_cause_of_its_own():
    loop = branches(0.1, -0.5, 0.5)

    def signal(torque, down):
        return loop(torque, down) - 0.4 * torque * np.abs(torque) / TOP**2

    names = {cause.name for cause in diagnose_loads(loads(signal, positions=2), PROFILE).causes}
    assert "hysteresis" in names
    assert len(names) == 2


@pytest.mark.campaign
def test_friction_of_one_width_is_one_cause():
    def signal(torque, down):
        inside = (np.abs(torque) > 0.0) & (np.abs(torque) < TOP)
        return torque + np.sign(torque) * inside * (0.1 if down else -0.1)

    found = diagnose_loads(loads(signal, positions=2, seed=3), PROFILE)
    cause = one_cause(found)
    assert cause.name == "hysteresis"
    assert {term.name for term in found.model.causes} == {"hysteresis"}


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.campaign)])
def test_a_loop_that_widens_after_each_reversal_is_not_told_from_a_creep_at_an_even_pace(seed):
    def signal(torque, down):
        size = np.abs(torque)
        gone = TOP - size if down else size
        return torque + np.sign(torque) * (1 if down else -1) * 0.15 * (1.0 - np.exp(-gone / 6.0))

    (cause,) = diagnose_loads(loads(signal, positions=2, seed=seed), PROFILE).causes
    assert {"hysteresis", "creep"} <= {cause.name, *cause.group, *cause.rivals}


def far_bending(tilt_rad, bend_rad):
    """An arm that hangs by a tilt and bends by so much under the largest load."""

    def signal(torque, _down):
        size, bend = np.abs(torque), np.zeros(len(torque))
        for _ in range(40):
            bend = bend_rad * size / TOP * np.cos(tilt_rad + bend)
        return np.sign(torque) * size * np.cos(tilt_rad + bend) / np.cos(tilt_rad)

    return signal


@pytest.mark.parametrize("bend_rad", [pytest.param(0.03, marks=pytest.mark.campaign), 0.09])
def test_an_arm_that_bends_so_far_that_it_loses_lever_arm_is_an_arm(bend_rad):
    # it rises by the cosine of its tilt before it falls: a limit never does
    readings = loads(far_bending(-0.08, bend_rad))
    found = diagnose_loads(readings, PROFILE)
    cause = one_cause(found)
    assert cause.name == "arm-sag"
    assert cause.rivals == ()
    assert cause.probability > 0.95
    assert misfit_nm(found.model, readings) < 1.5 * NOISE_NM


def test_a_name_without_rivals_is_likely_and_one_with_rivals_says_how_much():
    (clear,) = diagnose_loads(loads(branches(0.25, 0.0, 1.0), positions=2), PROFILE).causes
    assert clear.rivals == ()
    assert clear.probability > 0.95
    # noise of 4 mN m hides what tells so small a bend from others
    (bent,) = diagnose_loads(loads(far_bending(0.02, 0.02), seed=1), PROFILE).causes
    assert len({bent.name, *bent.group, *bent.rivals}) == 3
    assert 1.0 / 3.0 < bent.probability < 0.9
