"""Strain-gauge bridge against the report's equations and closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plant_tools import profile

from hdbench.plant.bridge import GaugeBridge, place_gauges
from hdbench.profile.schema import HarmonicParameters

SENSOR = profile().sensor
BETA = np.arange(720) * (2.0 * math.pi / 720)
# amplifier 1000, supply 10 V, gauge factor 2, 6.6 N m/V
PERFECT = GaugeBridge(20000.0, 1.0 / 132000.0, 200e-6, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0))
SINGLE_V = 0.5 * 200e-6 * 20000.0


def _order(signal: np.ndarray, order: int) -> complex:
    """Return amplitude and phase of cos(order beta + phase) as one number."""
    return complex(2.0 * np.mean(signal * np.exp(-1j * order * BETA)))


def test_equations_two_and_three_hold_for_the_first_two_rosettes():
    torsion = 40.0 / 132000.0
    first, second = PERFECT.rosette_strains(np.full_like(BETA, 40.0), BETA)[:2]
    # rounding of strains of 2e-4
    for found, phase in ((first, 0.0), (second, math.pi)):
        expected = 2 * torsion + 200e-6 * np.sin(2 * BETA - phase)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-17)


@pytest.mark.parametrize("degrees", [0.5, 1.0, 2.0, 10.0])
def test_one_wrong_rosette_of_four_leaves_half_the_sine_of_its_error(degrees):
    delta = math.radians(degrees)
    bridge = replace(PERFECT, placement_error_rad=(0.0, delta, 0.0, 0.0))
    left = _order(bridge.output_v(np.zeros_like(BETA), BETA), 2)
    # closed form on both sides: rounding of a Fourier sum
    assert abs(left) == pytest.approx(SINGLE_V * math.sin(delta) / 2, rel=1e-12)


def test_ninety_degrees_do_not_cancel_the_second_harmonic():
    bridge = replace(PERFECT, wave_harmonic=0.1)
    left = bridge.output_v(np.zeros_like(BETA), BETA)
    # closed form on both sides: rounding of a Fourier sum
    assert abs(_order(left, 4)) == pytest.approx(0.1 * SINGLE_V, rel=1e-12)
    assert abs(_order(left, 2)) < 1e-14


@settings(max_examples=40)
@given(st.floats(0.0, 2.0), st.floats(-3.1, 3.1), st.floats(0.0, 2.0), st.floats(-3.1, 3.1))
def test_misplaced_gauges_leave_exactly_the_ripple_of_the_profile(
    second_nm, second_rad, fourth_nm, fourth_rad
):
    parts = ((2, second_nm, second_rad), (4, fourth_nm, fourth_rad))
    ripple = [HarmonicParameters(order=n, amplitude_nm=a, phase_rad=p) for n, a, p in parts]
    bridge, rest = place_gauges(SENSOR, ripple)
    assert rest == ()
    torque = 6.6 * bridge.output_v(np.full_like(BETA, 3.0), BETA)
    expected = 3.0 + sum(a * np.cos(n * BETA + p) for n, a, p in parts)
    # sums of a few terms of order 10 N m in double precision
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-12)


def test_what_gauges_cannot_explain_is_torque_in_the_mesh():
    third = HarmonicParameters(order=3.0, amplitude_nm=0.1)
    huge = HarmonicParameters(order=2.0, amplitude_nm=9.0)
    fine = HarmonicParameters(order=4.0, amplitude_nm=0.2)
    bridge, rest = place_gauges(SENSOR, (third, huge, fine))
    assert rest == (third, huge)
    assert bridge.placement_error_rad == (0.0, 0.0, 0.0, 0.0)


def test_without_wave_strain_all_ripple_is_in_the_mesh():
    sensor = SENSOR.model_copy(update={"wave_strain": 0.0})
    ripple = (HarmonicParameters(order=2.0, amplitude_nm=0.4),)
    bridge, rest = place_gauges(sensor, ripple)
    assert rest == ripple
    # four equal arms: the differences are exactly 0
    np.testing.assert_allclose(bridge.output_v(np.zeros(5), BETA[:5]), 0.0, rtol=0, atol=0)
