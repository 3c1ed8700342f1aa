"""Makes the helpers beside the tests importable; nothing stays open behind a test."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "plant")]

from leftovers import nothing_stays_open  # noqa: E402, F401
