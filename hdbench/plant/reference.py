"""The motor reference by holds: a generator's values, and what a host writes over them."""

from __future__ import annotations

from collections import deque

import numpy as np

from hdbench.model.program import ReferenceProgram, program_voltage
from hdbench.model.waves import reference_voltage
from hdbench.profile.schema import ReferenceWave
from hdbench.records.trace import FloatArray

__all__ = ["ReferenceLine", "reference_values_v"]


class ReferenceLine:
    """One output that holds its value for a sampling period.

    Parameters
    ----------
    values_v : ndarray, shape (n,)
        Value of every hold from 0 on, V; the last one stays. At least one.
    """

    def __init__(self, values_v: FloatArray) -> None:
        self._values_v = values_v
        self._written: deque[tuple[int, float]] = deque()
        self._end: int | None = None

    @property
    def ended(self) -> bool:
        """Whether the output was zeroed for good."""
        return self._end is not None

    def values(self, first: int, count: int) -> FloatArray:
        """Return the output of `count` holds from `first` on."""
        holds = np.arange(first, first + count)
        volts = self._values_v[np.clip(holds, 0, len(self._values_v) - 1)]
        volts = np.where(holds >= 0, volts, 0.0)
        for hold, value_v in self._written:
            volts = np.where(holds >= hold, value_v, volts)
        if self._end is not None:
            volts = np.where(holds < self._end, volts, 0.0)
        return volts

    def write(self, hold: int, value_v: float) -> None:
        """Put out `value_v` from `hold` on, in place of what stood there."""
        if self._written and self._written[-1][0] == hold:
            self._written.pop()
        self._written.append((hold, value_v))

    def end(self, hold: int) -> None:
        """Zero the output from `hold` on, for good."""
        self._end = hold

    def forget(self, before: int) -> None:
        """Drop written values that ended before the hold `before`."""
        while len(self._written) > 1 and self._written[1][0] <= before:
            self._written.popleft()


def reference_values_v(
    sample_period_s: float, wave: ReferenceWave | ReferenceProgram | None, duration_s: float
) -> FloatArray:
    """Return the reference at every sample of an acquisition, at least one."""
    if isinstance(wave, ReferenceProgram):
        return program_voltage(wave, sample_period_s)
    n_samples = max(1, round(duration_s / sample_period_s))
    if wave is None:
        return np.zeros(n_samples)
    time_s = np.arange(n_samples, dtype=np.float64) * sample_period_s
    # where rounding puts the last sample at the end, the generator still runs
    return reference_voltage(wave, time_s, max(duration_s, n_samples * sample_period_s))
