"""Tests that watch a clock, other processes or the wire get three tries.

A deadline on a shared machine can be missed for no fault of the code: the scheduler gives the
time slice to somebody else. What calculates is never tried again; a wrong number stays wrong.

Examples of hypothesis are the same in every run and have no deadline: the suite says whether a
change is good, looking for new inputs is the work of `tools/faults/inputs.py`.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "suite", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("suite")

_HERE = Path(__file__).parent
# real sockets, pseudo-terminals, processes, signals, a browser
_IN_REAL_TIME = ("cli", "devices", "docs", "report", "session")
_TRIES_AGAIN = 2


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what runs in real time."""
    for item in items:
        if item.path.relative_to(_HERE).parts[0] in _IN_REAL_TIME:
            item.add_marker(pytest.mark.flaky(reruns=_TRIES_AGAIN, reruns_delay=1))
