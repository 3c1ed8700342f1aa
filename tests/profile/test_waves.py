import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdbench.profile.schema import ReferenceWave
from hdbench.profile.waves import reference_voltage


def level_by_hand(wave: str, p: Fraction, duty: Fraction, rise: Fraction, fall: Fraction) -> float:
    """Return a wave of amplitude 1 at the share `p` of its period, case by case."""
    if wave == "square":
        return 1.0 if p < duty else -1.0
    if wave == "triangle":
        if p <= Fraction(1, 4):
            return float(4 * p)
        if p <= Fraction(3, 4):
            return float(1 - 4 * (p - Fraction(1, 4)))
        return float(-1 + 4 * (p - Fraction(3, 4)))
    sign, h = (1, 2 * p) if p < Fraction(1, 2) else (-1, 2 * p - 1)
    if h < rise:
        return sign * float(h / rise)
    if h < rise + duty:
        return float(sign)
    if h < rise + duty + fall:
        return sign * float((rise + duty + fall - h) / fall)
    return 0.0


@pytest.mark.parametrize("wave", ["square", "triangle", "trapezoid"])
@given(st.integers(0, 1023), st.integers(0, 50), st.tuples(*[st.integers(0, 300)] * 3))
def test_piecewise_waves_follow_their_definition(wave, index, periods, edges):
    # shares in 1/1001, times in 1/1024 of a period: no sample falls on an edge by rounding, but for
    # zero and one half, which are exact in binary
    duty, rise, fall = (Fraction(e, 1001) for e in edges)
    shares = {"duty": float(duty), "rise": float(rise), "fall": float(fall)}
    reference = ReferenceWave(wave=wave, bias_v=0.25, amplitude_v=2.0, frequency_hz=0.5, **shares)
    p = Fraction(index, 1024)
    got = reference_voltage(reference, np.array([float(2 * (p + periods))]), 1e3)
    want = 0.25 + 2.0 * level_by_hand(wave, p, duty, rise, fall)
    # the slope of an edge of 1/1001 magnifies the rounding of the time a thousandfold
    assert got[0] == pytest.approx(want, rel=0, abs=1e-9)


def test_sine_and_constant_are_what_they_say():
    times = np.linspace(0.0, 0.99, 34)
    sine = ReferenceWave(wave="sine", bias_v=-0.5, amplitude_v=3.0, frequency_hz=2.5)
    want = [-0.5 + 3.0 * math.sin(2 * math.pi * 2.5 * t) for t in times]
    got = reference_voltage(sine, times, 1.0)
    # rounding of a few operations on numbers near one
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-12)
    constant = ReferenceWave(wave="constant", bias_v=0.5, amplitude_v=1.0)
    assert (reference_voltage(constant, times, 1.0) == 1.5).all()


def test_chirp_runs_from_the_first_to_the_second_frequency():
    wave = ReferenceWave(wave="chirp", amplitude_v=1.0, frequency_hz=2.0, end_frequency_hz=10.0)
    times = np.arange(0.0, 5.0, 1e-4)
    got = reference_voltage(wave, times, 5.0)
    # cycles completed by t: the integral of 2 + 8 t / 5, that is 2 t + 0.8 t^2; 30 after 5 s
    rising = np.flatnonzero((got[:-1] < 0.0) & (got[1:] >= 0.0))
    cycles = 2.0 * times[rising + 1] + 0.8 * times[rising + 1] ** 2
    # a crossing lies within one step of 0.1 ms, at 10 Hz a thousandth of a cycle
    np.testing.assert_allclose(cycles, np.arange(1, 30), rtol=0, atol=2e-3)


def test_the_generator_is_silent_outside_the_run():
    wave = ReferenceWave(wave="constant", bias_v=2.0)
    got = reference_voltage(wave, np.array([-1e-9, 0.0, 0.999, 1.0, 5.0]), 1.0)
    assert got.tolist() == [0.0, 2.0, 2.0, 0.0, 0.0]


@pytest.mark.parametrize("duration", [0.0, -1.0, math.nan, math.inf])
def test_a_duration_that_is_none_is_refused(duration):
    with pytest.raises(ValueError, match="duration_s"):
        reference_voltage(ReferenceWave(wave="constant"), np.zeros(3), duration)


def test_a_time_that_is_none_is_refused():
    with pytest.raises(ValueError, match="time_s"):
        reference_voltage(ReferenceWave(wave="constant"), np.array([0.0, math.nan]), 1.0)
