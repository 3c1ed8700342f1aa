"""The person at the bench is asked plainly, and a no is a no."""

import click
import pytest
from click.testing import CliRunner

from hdbench_cli.asking.operator import ConsoleOperator


def ask(call, answer: str) -> tuple[bool, str]:
    told: list[bool] = []

    @click.command()
    def command() -> None:
        told.append(call())

    result = CliRunner().invoke(command, input=answer)
    assert result.exit_code == 0, result.output
    return told[0], result.stderr


@pytest.mark.parametrize(("answer", "meant"), [("\n", True), ("y\n", True), ("n\n", False)])
@pytest.mark.parametrize(
    ("mass_kg", "expected_nm", "asked"),
    [
        (2.0, -9.81, "hang 2 kg on the ccw side (expect -9.81 N m)"),
        (0.0, 0.0, "take all weights off"),
    ],
)
def test_a_weight_is_named_with_its_side_and_the_torque_to_expect(
    mass_kg, expected_nm, asked, answer, meant
):
    weight = {"direction": "ccw", "expected_nm": expected_nm, "step": "p1 2 of 9"}
    told, text = ask(lambda: ConsoleOperator().hang(mass_kg, **weight), answer)
    assert told is meant
    assert asked in text


def test_confirmed_motion_is_not_asked_for_again_but_the_lock_is():
    operator = ConsoleOperator(motion_confirmed=True)
    assert operator.confirm_motion("square reference for 2.0 s")
    assert operator.confirm_lock(locked=False)
    told, text = ask(lambda: operator.confirm_lock(locked=True), "n\n")
    assert not told
    assert "Lock the wave generator" in text


def test_a_position_is_asked_for_in_degrees():
    operator = ConsoleOperator()
    _, text = ask(lambda: operator.set_position(1.5707963, index=2, count=4), "\n")
    assert "position 2 of 4: 90.0 degrees" in text
