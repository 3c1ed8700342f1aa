"""Effects of a plant against their closed forms, and what a seed chooses."""

import itertools
import math
from collections import Counter

import numpy as np
import pytest
from plant_tools import WORN, plant

from hdbench.plant.effects import (
    AsymmetricFriction,
    Cogging,
    GainError,
    MotorOrder,
    OutputFriction,
    OutputOrder,
    PlantMotion,
    Tone,
    ToothBump,
    TransmissionError,
    ZeroDrift,
    ZeroStep,
    encoder_error_rad,
    start_effect,
)
from hdbench.plant.plantfile import draw_effects

TIME = np.linspace(-0.5, 9.5, 10_001)
SPEED = 60.0 * np.sin(TIME)
ANGLE = 60.0 * (1.0 - np.cos(TIME))
MOTION = PlantMotion(TIME, ANGLE, SPEED, ANGLE / 100, SPEED / 100, 3.0 * np.sin(2 * TIME))
# a few roundings of numbers of order one
EXACT = {"rtol": 0.0, "atol": 1e-12}


def torque_at_some_speeds(friction):
    speeds = np.array([-2.0, -0.01, 0.0, 0.01, 2.0])
    still = np.zeros_like(speeds)
    return friction.torque_nm(PlantMotion(still, still, 100 * speeds, still, speeds, still))


def test_friction_is_odd_half_way_at_the_transition_and_viscous_beyond():
    torque = torque_at_some_speeds(OutputFriction(0.3, 0.1, 0.01))
    np.testing.assert_allclose(torque, -torque[::-1], **EXACT)
    # closed form: rounding
    assert torque[3] == pytest.approx(0.15 + 0.001, rel=1e-12)
    # atan(200) is 1/200 short of a quarter turn
    assert torque[4] == pytest.approx(0.3 * (1 - 2 / math.pi / 200) + 0.2, rel=1e-6)


@pytest.mark.parametrize(
    ("effect", "torque_nm"),
    [
        (MotorOrder(6.0, 0.2, 0.5), 0.2 * np.cos(6 * ANGLE + 0.5)),
        (OutputOrder(2.0, 0.4, -0.5), 0.4 * np.cos(2 * ANGLE / 100 - 0.5)),
        # by the clock alone
        (Tone(50.03, 0.1, 0.7), 0.1 * np.cos(2 * np.pi * 50.03 * TIME + 0.7)),
        (GainError(0.02), 0.06 * np.sin(2 * TIME)),
        (ZeroStep(4.0, -0.2), np.where(TIME >= 4.0, -0.2, 0.0)),
        # from the start of the acquisition
        (ZeroDrift(0.01), 0.01 * np.clip(TIME, 0.0, None)),
        (TransmissionError(1.0, 0.02, 0.7), np.zeros_like(TIME)),
        (Cogging(12.0, 0.2, 0.5, 0.0), 0.2 * np.cos(12 * ANGLE + 0.5)),
        # a row of harmonics that decays: 0.3^30 is 2e-16
        (
            Cogging(12.0, 0.2, 0.5, 0.3),
            sum(0.2 * 0.3 ** (k - 1) * np.cos(k * (12 * ANGLE + 0.5)) for k in range(1, 31)),
        ),
    ],
)
def test_the_torque_of_an_effect_is_its_closed_form(effect, torque_nm):
    np.testing.assert_allclose(effect.torque_nm(MOTION), torque_nm, **EXACT)


def test_a_tooth_bump_returns_once_per_output_turn():
    bump = ToothBump(6.2, 0.05, 0.3)
    angles = np.array([6.2, 6.25, 6.2 - 2 * math.pi, 6.2 + 4 * math.pi, 3.0])
    still = np.zeros_like(angles)
    torque = bump.torque_nm(PlantMotion(still, 100 * angles, still, angles, still, still))
    # angles of whole turns, rounded, on a bump of 0.05 rad
    np.testing.assert_allclose(torque[[0, 2, 3]], 0.3, rtol=1e-9, atol=0)
    assert torque[1] == pytest.approx(0.3 * math.exp(-0.5), rel=1e-9)
    assert torque[4] < 1e-100


def test_friction_by_direction_is_even_and_half_way_at_the_transition():
    torque = torque_at_some_speeds(AsymmetricFriction(0.3, -0.1, 0.01))
    # closed form: rounding
    want = [0.3 * 4 / 4.0001 - 0.2, 0.15 - 0.001, 0.0, 0.15 - 0.001, 0.3 * 4 / 4.0001 - 0.2]
    np.testing.assert_allclose(torque, want, **EXACT)


def test_a_transmission_error_is_an_angle():
    once, motor = TransmissionError(1.0, 0.02, 0.7), TransmissionError(100.0, 0.001, 0.0)
    error = encoder_error_rad((GainError(0.1), once, motor), ANGLE, 100.0)
    want = 0.02 * (np.cos(ANGLE / 100 + 0.7) - math.cos(0.7)) + 0.001 * (np.cos(ANGLE) - 1)
    np.testing.assert_allclose(error, want, **EXACT)


def test_a_tone_without_phase_gets_a_new_one_in_every_acquisition():
    tone = Tone(50.0, 0.1, None)
    phases = [start_effect(tone, np.random.default_rng(seed)).phase_rad for seed in (1, 2)]
    assert None not in phases
    assert phases[0] != phases[1]
    fixed = Tone(50.0, 0.1, 0.25)
    assert start_effect(fixed, np.random.default_rng(1)) is fixed


# what 400 seeds choose
DRAWN = [draw_effects(WORN, np.random.default_rng(seed)) for seed in range(400)]


def test_worn_chooses_two_effects_or_more_and_every_kind_at_its_probability():
    assert min(map(len, DRAWN)) >= 2
    counts = Counter(type(effect).__name__ for effect in itertools.chain(*DRAWN))
    assert set(counts) == {"OutputFriction", "MotorOrder", "OutputOrder", "Tone"}
    # 0.8 each, a little more for the minimum of two (0.8 + 0.0272 * 2/4 at most); six sigma of
    # sqrt(400 * 0.8 * 0.2) = 8: false alarm 1e-8
    assert all(320 - 48 <= count <= 331 + 48 for count in counts.values())


def test_worn_keeps_to_its_ranges():
    for effect in itertools.chain(*DRAWN):
        if isinstance(effect, OutputFriction):
            assert 0.15 <= effect.coulomb_nm <= 0.45
        elif isinstance(effect, MotorOrder):
            assert effect.order in (3.0, 6.0, 8.0)
            assert 0.08 <= effect.amplitude_nm <= 0.25
        elif isinstance(effect, OutputOrder):
            assert effect.order == 2.0
        else:
            assert 49.95 <= effect.frequency_hz <= 50.05


def test_an_effect_of_probability_zero_is_never_chosen():
    never = {"kind": "gain-error", "fraction": 0.1, "probability": 0.0}
    spec = plant(effects=[never, {"kind": "zero-drift", "rate_nm_per_s": 0.1}])
    for seed in range(20):
        assert draw_effects(spec, np.random.default_rng(seed)) == (ZeroDrift(0.1),)
