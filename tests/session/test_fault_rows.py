"""Reduced campaigns: refusals, broken channels, counters, clocks, people, disks that fail."""

import shutil
import sys

import pytest
from faults import answers, disk, people, samples

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="terminals and preloading of Linux")
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
COMPILED = (on_linux, needs_compiler)


@pytest.mark.parametrize(
    ("campaign", "trials", "notes"),
    [
        (answers.refusals, 40, {}),
        (answers.waits, 8, {}),
        (answers.wraps, 264, {}),
        (samples.broken_channels, 6, {}),
        # the first two: a terminal that is closed, the end of input
        pytest.param(people.people, 2, {}, marks=on_linux),
        # a wall clock that is set changes no byte
        pytest.param(people.clock_steps, 1, {}, marks=COMPILED),
        # writes and syncs 1, 2, ... of a run; the campaign does the first 200
        pytest.param(disk.full_disks, 3, {"exit 7": 3}, marks=COMPILED),
        pytest.param(disk.failing_disks, 4, {"exit 7": 4}, marks=COMPILED),
    ],
)
def test_every_trial_goes_as_required(monkeypatch, tmp_path, campaign, trials, notes):
    # ten minutes of motion without a fault: test_limits
    monkeypatch.setattr(samples, "CLEAN_SAMPLES", 10_000)
    row = campaign(tmp_path, trials, 0)
    assert row.bad == []
    assert row.trials == row.good == trials
    assert not row.lost  # None where nothing is measured
    assert {key: row.notes[key] for key in notes} == notes
