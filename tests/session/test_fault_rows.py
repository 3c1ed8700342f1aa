"""Reduced campaigns: refusals, broken channels, counters, clocks, people, disks that fail."""

import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from faults import answers, disk, people, samples

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="terminals and preloading of Linux")
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")


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
@needs_compiler
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


@on_linux
@needs_compiler
@pytest.mark.parametrize(("campaign", "trials"), [(disk.full_disks, 3), (disk.failing_disks, 4)])
def test_the_first_writes_and_syncs_that_fail(tmp_path, campaign, trials):
    """Writes 1, 2, ... and syncs 1, 2, ... of a run; the campaign does the first 200."""
    row = campaign(tmp_path, trials, 0)
    assert row.bad == []
    assert row.trials == row.good == trials
    assert row.lost == 0
    assert row.notes["exit 7"] == trials
