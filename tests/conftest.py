"""Examples of hypothesis are the same in every run and have no deadline.

The suite says whether a change is good; looking for new inputs is the work of
`tools/faults/inputs.py`.
"""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

settings.register_profile(
    "suite", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("suite")


def pytest_xdist_auto_num_workers() -> int:
    """Return one worker more than cores: many tests wait for a device or a deadline."""
    return (os.cpu_count() or 1) + 1
