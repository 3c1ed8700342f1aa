"""Examples of hypothesis are the same in every run and have no deadline.

The suite says whether a change is good; looking for new inputs is the work of
`tools/faults/inputs.py`.
"""

from __future__ import annotations

from hypothesis import HealthCheck, settings

settings.register_profile(
    "suite", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("suite")
