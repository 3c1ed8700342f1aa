"""Makes the helpers of the devices importable; nothing stays open, emulators are forks."""

import sys
from pathlib import Path

HELPERS = ("tests/devices", "tests/drivers/dataq", "tests/drivers/labjack", "tools")
sys.path[:0] = [str(Path(__file__).parents[2] / folder) for folder in HELPERS]

from forked import warm_emulators  # noqa: E402, F401
from leftovers import nothing_stays_open, patient_control  # noqa: E402, F401
