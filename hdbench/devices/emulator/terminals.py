"""What stands at the terminals of the simulated bench, and the clock that it goes by."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

__all__ = ["ChannelFault", "DeviceClock", "ElectricalSamples", "Input"]

Input = Literal["torque", "tacho", "current", "reference"]
"""An analog input."""

ChannelFault = Literal["stuck", "high", "low"]
"""What can be wrong with an input."""


@dataclass(frozen=True, slots=True)
class DeviceClock:
    """A clock that runs `speed` times as fast as the monotonic one, from 0.

    Parameters
    ----------
    speed : float
        Device seconds per second, above 0.
    start_s : float
        Monotonic time of its zero, s; default 0.
    clock : callable
        Monotonic clock, s.
    """

    speed: float = 1.0
    start_s: float = 0.0
    clock: Callable[[], float] = time.monotonic

    def __call__(self) -> float:
        """Return device time, s."""
        return self.speed * (self.clock() - self.start_s)


@dataclass(frozen=True, slots=True)
class ElectricalSamples:
    """What stands at the terminals at the sampling instants.

    Parameters
    ----------
    first_index : int
        Index of the first sample since `begin`.
    volts : dict of str to ndarray, shape (n,)
        ``torque``, ``tacho``, ``current``, ``reference`` in V, before any converter.
    count : ndarray of int64, shape (n,)
        Quadrature counts since the device was switched on; never wraps.
    """

    first_index: int
    volts: dict[Input, FloatArray]
    count: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.count)
