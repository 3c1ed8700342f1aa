"""Numbers for people carry as many digits as their uncertainty allows."""

from __future__ import annotations

import pytest

from hdbench_cli.numbers import probability, with_uncertainty


@pytest.mark.parametrize(
    ("value", "std", "dof", "text"),
    [
        (6.6123, 0.0484, 3, "6.612 +- 0.048 N m/V (3 dof)"),
        (123436.96, 394.27, 18, "123437 +- 394 N m/V (18 dof)"),
        (0.39, 0.0, None, "0.39 N m/V"),
        (-1.2, 0.999, None, "-1.20 +- 1.00 N m/V"),
    ],
)
def test_two_digits_of_the_uncertainty_are_told(value, std, dof, text) -> None:
    assert with_uncertainty({"value": value, "std": std, "dof": dof}, "N m/V") == text


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "below 1e-9"), (1e-30, "below 1e-9"), (0.00213, "0.0021")]
)
def test_no_false_alarm_is_called_impossible(value: float, text: str) -> None:
    assert probability(value) == text
