"""The motor reference where this computer makes it: what is due, and what was put out."""

from __future__ import annotations

import math
import threading

import numpy as np

from hdbench.errors import UsageError
from hdbench.model.program import ReferenceProgram, program_voltage
from hdbench.model.waves import reference_voltage
from hdbench.profile.schema import ReferenceWave
from hdbench.records.trace import FloatArray

__all__ = ["HostReference", "ReferenceLog"]

# a decimal limit and the sum of bias and amplitude differ by rounding only
_ROUNDING = 1e-9
_KEPT = 64


class HostReference:
    """The reference as a function of time since the start.

    Parameters
    ----------
    reference : ReferenceWave or ReferenceProgram
        What is asked for, V.
    sample_period_s : float
        Sampling period, s: the grain of the reference, as in a device with a generator.
    n_samples : int
        Samples of the acquisition; 0 V after them.
    limit_v : float
        Largest value, either sign, V.
    slew_v_per_s : float
        Fastest change, V/s.

    Raises
    ------
    UsageError
        If the reference goes beyond the limit anywhere.
    """

    def __init__(
        self,
        reference: ReferenceWave | ReferenceProgram,
        sample_period_s: float,
        n_samples: int,
        *,
        limit_v: float,
        slew_v_per_s: float,
    ) -> None:
        if isinstance(reference, ReferenceProgram):
            values = program_voltage(reference, sample_period_s)
        else:
            time_s = np.arange(n_samples, dtype=np.float64) * sample_period_s
            values = reference_voltage(reference, time_s, n_samples * sample_period_s)
        peak_v = float(np.max(np.abs(values)))
        if not peak_v <= limit_v * (1.0 + _ROUNDING):
            raise UsageError(
                f"the reference reaches {peak_v:.6g} V; allowed {limit_v:g} V",
                where="motor reference",
                fix="ask for less, or raise limits.reference_v and daq.output.limit_v",
            )
        self._values = values
        self._period_s = sample_period_s
        self._slew_v_per_s = slew_v_per_s

    @property
    def duration_s(self) -> float:
        """Length, s."""
        return len(self._values) * self._period_s

    def value_v(self, time_s: float, last_v: float, since_s: float) -> float:
        """Return what is to be put out at `time_s`."""
        index = math.floor(time_s / self._period_s)
        wanted_v = float(self._values[index]) if 0 <= index < len(self._values) else 0.0
        step_v = self._slew_v_per_s * max(0.0, since_s)
        return min(max(wanted_v, last_v - step_v), last_v + step_v)


class ReferenceLog:
    """What was put out, and when; written by one thread, read by another.

    Parameters
    ----------
    start_s, value_v : float
        Host's clock, s, and the value that stands there then, V.
    """

    def __init__(self, start_s: float, value_v: float) -> None:
        self._lock = threading.Lock()
        self._time_s = [start_s]
        self._value_v = [value_v]
        self.worst_write_s = 0.0

    def add(self, before_s: float, after_s: float, value_v: float) -> None:
        """Note a confirmed write."""
        with self._lock:
            self._time_s.append(0.5 * (before_s + after_s))
            self._value_v.append(value_v)
            self.worst_write_s = max(self.worst_write_s, after_s - before_s)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the output at each of the times, V; before the first write its first value."""
        with self._lock:
            index = np.searchsorted(self._time_s, time_s, side="right") - 1
            values = np.asarray(self._value_v, dtype=np.float64)
            found: FloatArray = values[np.maximum(index, 0)]
            # the clock of the samples moves by less than a few writes: older ones are forgotten
            done = max(0, int(index[0]) - _KEPT) if len(index) else 0
            del self._time_s[:done], self._value_v[:done]
        return found
