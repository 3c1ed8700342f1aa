"""How nearly a loop over the load and a creep over the time are the same on these readings."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.loads.table import LoadTable

__all__ = ["MEMORY", "memory_share"]

# a loop from rest on equal steps is nearly a creep
_LIKE_MEMORY = 0.97
# ... and where readings follow each other at an even pace, time and load run together: what a loop
# does over the load (one that widens as an exponential after each reversal) is then all but what a
# creep does over the time, and only the readings at the turning points tell them apart
_LIKE_EVEN = 0.9
# scatter of load per time, of its mean, up to which a pace is even
_EVEN = 0.25
MEMORY = frozenset({"hysteresis", "creep"})
# readings with the same stamp
_LEAST_TIME_S = 1e-9


def memory_share(table: LoadTable) -> float:
    """Return the share of a loop that a creep must explain to be its rival, and the reverse.

    Parameters
    ----------
    table : LoadTable
        Readings.

    Returns
    -------
    float
        Smaller where the load changes at an even pace.
    """
    inside = np.diff(table.experiment) == 0
    change = np.abs(np.diff(table.torque_nm))[inside]
    moved = change > 0.0
    pace = change[moved] / np.maximum(np.diff(table.motion.time_s)[inside][moved], _LEAST_TIME_S)
    even = bool(len(pace)) and float(pace.std()) < _EVEN * float(pace.mean())
    return _LIKE_EVEN if even else _LIKE_MEMORY
