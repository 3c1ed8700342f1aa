"""Where each number stands in the filter's state vector (shared by both kernel forms)."""

from __future__ import annotations

__all__ = [
    "ACCELERATION",
    "ANGLE",
    "HAS_ANGLE",
    "HAS_VELOCITY",
    "HEADER",
    "MAX_BLOCKS",
    "SEEN",
    "STARTED",
    "TIME",
    "USABLE",
    "VELOCITY",
    "VELOCITY_TIME",
    "state_size",
]

SEEN, HAS_VELOCITY, HAS_ANGLE, STARTED = 0, 1, 2, 3
TIME, VELOCITY, VELOCITY_TIME, ACCELERATION, ANGLE = 4, 5, 6, 7, 8
HEADER = 9
MAX_BLOCKS = 16
USABLE = 1e12
"""Beyond this magnitude (rad/s, rad, N m) a sample is a fault and counts as missing."""


def state_size(n_blocks: int) -> int:
    """Return the length of the state vector of `n_blocks` oscillator blocks.

    Parameters
    ----------
    n_blocks : int
        Number of blocks, 1 to `MAX_BLOCKS`.

    Returns
    -------
    int
        Header, two states per block, and one triangle of their covariance.
    """
    return HEADER + 2 * n_blocks + n_blocks * (2 * n_blocks + 1)
