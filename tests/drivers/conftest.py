"""Makes the helpers of the devices importable; nothing stays open behind a test."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "devices"))

from leftovers import nothing_stays_open  # noqa: F401
