"""Laws without a name that are products: drag by the square of the speed, ripple by direction."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.diagnosis.measured.record import Record
from hdbench.model import Motion
from hdbench.records.trace import FloatArray

__all__ = ["by_direction", "square_of_speed", "turns_both_ways"]

# a direction counts from this share of the record on
_LEAST_SHARE = 0.05
# slower than this counts as rest, rad/s
_REST_RAD_S = 0.5


def square_of_speed(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    """Return the column of a drag that grows with the square of the speed, shape (n, 1).

    Parameters
    ----------
    motion : Motion
        Motion at every sample.
    shape : mapping of str to float
        Not used.

    Returns
    -------
    ndarray, shape (n_samples, 1)
        ``w abs(w)``, (rad/s)^2.
    """
    del shape
    speed = motion.velocity_rad_s
    return np.asarray((speed * np.abs(speed))[:, None])


def by_direction(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    """Return the columns of a friction that changes with the motor angle, shape (n, 2).

    Parameters
    ----------
    motion : Motion
        Motion at every sample.
    shape : mapping of str to float
        ``order``, cycles per motor turn, and ``turn_over_rad_s``, speed w_0 over which friction
        turns over at a reversal, rad/s.

    Returns
    -------
    ndarray, shape (n_samples, 2)
        ``tanh(w / w_0)`` times cosine and sine of the order: a ripple whose phase turns by half a
        turn with the direction.
    """
    sign = np.tanh(motion.velocity_rad_s / shape["turn_over_rad_s"])
    phase = shape["order"] * motion.angle_rad
    return np.column_stack([sign * np.cos(phase), sign * np.sin(phase)])


def turns_both_ways(record: Record) -> bool:
    """Return whether a record holds enough of both directions of turning.

    Parameters
    ----------
    record : Record
        Record.

    Returns
    -------
    bool
    """
    speed = record.motion.velocity_rad_s[record.valid]
    shares = [float(np.mean(side > _REST_RAD_S)) for side in (speed, -speed)]
    return min(shares) > _LEAST_SHARE
