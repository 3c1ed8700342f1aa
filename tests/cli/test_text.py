"""Numbers have as many digits as their uncertainty allows; a curve of characters has its shape."""

import math

import pytest

from hdbench_cli.text import (
    probability,
    sparkline,
    with_uncertainty,
)


@pytest.mark.parametrize(
    ("value", "std", "dof", "text"),
    [
        (6.6123, 0.0484, 3, "6.612 +- 0.048 N m/V (3 dof)"),
        (123436.96, 394.27, 18, "123437 +- 394 N m/V (18 dof)"),
        (0.39, 0.0, None, "0.39 N m/V"),
        (-1.2, 0.999, None, "-1.20 +- 1.00 N m/V"),
    ],
)
def test_two_digits_of_the_uncertainty_are_told(value, std, dof, text):
    assert with_uncertainty({"value": value, "std": std, "dof": dof}, "N m/V") == text


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "below 1e-9"), (1e-30, "below 1e-9"), (0.00213, "0.0021")]
)
def test_no_false_alarm_is_called_impossible(value, text):
    assert probability(value) == text


def test_a_ramp_becomes_rising_blocks():
    line = sparkline([float(x) for x in range(80)], 8, (0.0, 79.0))
    assert line == "".join(sorted(line))
    assert line[0] == "▁"
    assert line[-1] == "█"


def test_lost_values_leave_a_space_and_a_flat_curve_the_lowest_block():
    assert sparkline([math.nan, 1.0], 2, (0.0, 1.0), plain=True) == " @"
    assert sparkline([2.0, 2.0], 2, (2.0, 2.0), plain=True) == ".."


def test_no_line_is_longer_than_the_curve_or_the_width():
    assert len(sparkline([1.0] * 3, 40, (0.0, 1.0))) == 3
    assert len(sparkline([1.0] * 300, 40, (0.0, 1.0))) == 40
