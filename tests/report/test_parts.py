import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdbench.report.canvas import min_max
from hdbench.report.numbers import short
from hdbench.report.pagemodel import KeyNumber
from hdbench.report.signals import Signals, steady_stretch


@given(st.integers(0, 2**31), st.integers(1, 400), st.integers(1, 60))
def test_thinning_keeps_the_extremes_the_order_and_only_real_points(seed, n, bins):
    y = np.random.default_rng(seed).standard_normal(n)
    x = np.arange(float(n))
    few_x, few_y = min_max(x, y, bins)
    assert few_y.min() == y.min()
    assert few_y.max() == y.max()
    assert len(few_x) <= 2 * bins
    assert (np.diff(few_x) > 0).all()
    assert (y[few_x.astype(int)] == few_y).all()


def test_lost_samples_break_the_line():
    y = np.ones(1000)
    y[500:520] = math.nan
    few_x, few_y = min_max(np.arange(1000.0), y, 50)
    assert np.isnan(few_y).any()
    broken = few_x[np.isnan(few_y)]
    assert broken.min() >= 500
    assert broken.max() <= 520


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        *((6.6123, 0.0484, "6.612"), (123456.7, 120.0, "123460"), (0.0996, 0.00996, "0.0996")),
        *((-0.5, 0.02, "\N{MINUS SIGN}0.500"), (6.6, 0.224563, "6.60"), (6.6, 0.0, "6.6")),
        *((2.0, None, "2"), (0.0001234567, None, "0.0001235")),
    ],
)
def test_a_number_has_the_digits_that_its_uncertainty_allows(value, std, text):
    assert short(value, std) == text


def test_the_interval_uses_the_degrees_of_freedom():
    number = KeyNumber("gain", "gain", 6.6, "N·m/V", "x", 0.1, 3.0)
    ends = number.interval()
    # Student's t, 3 dof, 97.5 %: 3.182446 (published tables)
    assert ends[1] == pytest.approx(6.6 + 0.3182446, rel=0, abs=1e-7)
    assert KeyNumber("n", "n", 1.0, "", "x").interval() is None


def test_the_steady_stretch_of_a_figure_has_the_velocity_that_was_held_longest():
    # 700 samples at 150 rad/s in two parts, more than the 600 in a row at 60 rad/s
    ramp = np.linspace(0.0, 150.0, 200)
    parts = (ramp, np.full(300, 150.0), np.full(600, 60.0), np.full(400, 150.0), ramp[::-1])
    velocity = np.concatenate(parts)
    time = 0.001 * np.arange(len(velocity))
    torque = np.ones(len(velocity))
    # a level ends on the ramp within 4 % of 150 rad/s: 8 samples
    found = steady_stretch(Signals(time, torque, velocity), 0.02)
    assert (found.start, found.stop) == (1100, pytest.approx(1500, abs=9))
    assert found.velocity_rad_s == pytest.approx(150.0, rel=0.001)
    # a missing torque in the middle leaves the first part as the longest
    torque[1300] = math.nan
    found = steady_stretch(Signals(time, torque, velocity), 0.02)
    assert (found.start, found.stop) == (pytest.approx(200, abs=9), 500)


@pytest.mark.parametrize("velocity", [np.zeros(500), np.linspace(1.0, 150.0, 500)])
def test_no_steady_stretch_in_a_sweep_or_at_rest(velocity):
    signals = Signals(0.001 * np.arange(500.0), np.ones(500), velocity)
    assert steady_stretch(signals, 0.02) is None
