"""Tests that watch a clock, other processes or the wire get three tries.

A deadline on a shared machine can be missed for no fault of the code: the scheduler gives the
time slice to somebody else. What calculates is never tried again; a wrong number stays wrong.

Examples of hypothesis are the same in every run and have no deadline: the suite says whether a
change is good, looking for new inputs is the work of `tools/faults/inputs.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

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


@pytest.fixture
def named_cause() -> Callable[..., dict[str, Any]]:
    """Return a function that makes a cause of a stored diagnosis from its name and parameters."""

    def made(name: str, parameters: dict[str, Any], **changes: Any) -> dict[str, Any]:
        return {
            "name": name,
            "group": [name],
            "rivals": [],
            "parameters": parameters,
            "evidence_nats": 40.0,
            "false_alarm_probability": 1e-12,
            "gain": {
                "heldout_rms_before_nm": 0.2,
                "heldout_rms_after_nm": 0.166,
                "explained_fraction": 0.312,
                "interval": [0.3, 0.33],
            },
            "separating_experiment": None,
            "share_of_variance": 0.3,
            "domain": "motor-order",
            **changes,
        }

    return made
