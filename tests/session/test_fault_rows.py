"""A reduced campaign of refusals, broken channels, wrapping counters, clock steps and people."""

import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from faults import answers, people, samples

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="terminals and preloading of Linux")


@pytest.mark.parametrize(
    ("campaign", "trials"),
    [
        (answers.refusals, 40),
        (answers.waits, 8),
        (answers.wraps, 264),
        (samples.broken_channels, 6),
    ],
)
def test_every_trial_goes_as_required(tmp_path, campaign, trials):
    row = campaign(tmp_path, trials, 0)
    assert row.bad == []
    assert row.trials == row.good == trials


@on_linux
@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_a_wall_clock_that_is_set_changes_no_byte(tmp_path):
    row = people.clock_steps(tmp_path, 1, 0)
    assert row.bad == []
    assert row.trials == 1


@on_linux
def test_a_person_who_does_not_say_yes_moves_nothing(tmp_path):
    # the first two: a terminal that is closed, the end of input
    row = people.people(tmp_path, 2, 0)
    assert row.bad == []
    assert row.trials == 2
