"""Where each number stands in the filter's vectors (shared by both kernel forms)."""

from __future__ import annotations

__all__ = [
    "ACCELERATION",
    "ANGLE",
    "BLOCK",
    "GATED",
    "GATED_RUN",
    "HAS_ANGLE",
    "HAS_VELOCITY",
    "HEADER",
    "INVERSE",
    "MAX_BLOCKS",
    "MISSING",
    "MODEL_HEADER",
    "SEEN",
    "STARTED",
    "STEP",
    "TIME",
    "UNRESOLVED",
    "USABLE",
    "VELOCITY",
    "VELOCITY_TIME",
    "state_size",
]

SEEN, HAS_VELOCITY, HAS_ANGLE, STARTED = 0, 1, 2, 3
TIME, VELOCITY, VELOCITY_TIME, ACCELERATION, ANGLE, GATED_RUN = 4, 5, 6, 7, 8, 9
INVERSE, STEP = 10, 11
"""1/S and e/S of the last sample: what its measurement is still to do to states and covariance."""
HEADER = 12
MODEL_HEADER = 9
BLOCK = 11
MAX_BLOCKS = 16
USABLE = 1e12
"""Beyond this magnitude (rad/s, rad, N m) a sample is a fault and counts as missing."""

MISSING, GATED, UNRESOLVED = 1, 2, 4
"""Bits of a sample's flag."""


def state_size(n_blocks: int) -> int:
    """Return the length of the state vector of `n_blocks` blocks."""
    return HEADER + 6 * n_blocks + n_blocks * (2 * n_blocks + 1)
