"""Makes the helpers of the devices importable; nothing stays open, emulators are forks."""

import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(TESTS / "devices"), str(TESTS.parent / "tools")]

from forked import warm_emulators  # noqa: E402, F401
from leftovers import nothing_stays_open, patient_control  # noqa: E402, F401
