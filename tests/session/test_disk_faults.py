"""A disk that fills up or fails at any write: exit 7, the motor stands, nothing kept is lost."""

import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from faults import disk

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("cc") is None, reason="needs a C compiler on Linux"
)


@pytest.mark.parametrize(("campaign", "trials"), [(disk.full_disks, 6), (disk.failing_disks, 8)])
def test_the_first_writes_and_syncs_that_fail(tmp_path, campaign, trials):
    """Writes 1, 2, ... and syncs 1, 2, ... of a run; the campaign does the first 200."""
    row = campaign(tmp_path, trials, 0)
    assert row.bad == []
    assert row.trials == row.good == trials
    assert row.lost == 0
    assert row.notes["exit 7"] == trials
