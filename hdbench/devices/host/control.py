"""Host control: the motor reference where this computer makes it, its thread and its checks."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass

import numpy as np

from hdbench.devices.daq import Daq
from hdbench.errors import DeviceError, HdbenchError, UsageError
from hdbench.profile.schema import ReferenceWave
from hdbench.profile.waves import ReferenceProgram, reference_values
from hdbench.records.trace import FloatArray

# a decimal limit and the sum of bias and amplitude differ by rounding only
_ROUNDING = 1e-9
_KEPT = 64
# a session that has not asked for samples for this long hangs: the motor must not go on
_ABSENT_S = 0.5
# the watchdog is fed at most every third of its time, so that one late turn does not trip it
_FEEDS_PER_TIME = 4.0
# a turn that comes this many updates late is no control any more
_LATE_UPDATES = 20.0
_LATE_S = 0.2
_JOIN_S = 1.0


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
        values = reference_values(reference, sample_period_s, n_samples * sample_period_s)
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

    def add(self, before_s: float, after_s: float, value_v: float) -> None:
        """Note a confirmed write."""
        with self._lock:
            self._time_s.append(0.5 * (before_s + after_s))
            self._value_v.append(value_v)

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


@dataclass(eq=False)
class ControlThread:
    """Puts a reference out until it is stopped.

    Parameters
    ----------
    daq : Daq
        The device; its output ``reference`` and its watchdog.
    reference : HostReference
        What is to be put out.
    log : ReferenceLog
        Takes what was put out.
    update_s, watchdog_s : float
        Time between two values, and the watchdog's, s.
    clock : callable
        Monotonic clock, s.
    speed : float
        Device seconds per second of `clock`; other than 1 for an accelerated emulator only.

    Notes
    -----
    Every turn, in this order: the session still takes samples; no limit was crossed; the thread
    itself is on time; the value is written and read back; the watchdog is fed. Whatever fails, in
    the device or in this program, puts 0 V out, ends the thread without feeding the watchdog, and
    is raised at the next `check`.
    """

    daq: Daq
    reference: HostReference
    log: ReferenceLog
    _: KW_ONLY
    update_s: float
    watchdog_s: float
    clock: Callable[[], float] = time.monotonic
    speed: float = 1.0

    def __post_init__(self) -> None:
        self._feed_s = self.watchdog_s / _FEEDS_PER_TIME
        self._halted = threading.Event()
        self._fault: HdbenchError | None = None
        self._crossed = ""
        self._thread = threading.Thread(target=self._run, name="hdbench-control", daemon=True)
        self._start_s = self._seen_s = self._fed_s = self._written_s = self.clock()
        self._last_v = 0.0

    def start(self, start_s: float) -> None:
        """Begin; time 0 of the reference is `start_s` on the clock."""
        self._start_s = self._seen_s = self._written_s = self._fed_s = start_s
        self._thread.start()

    def seen(self) -> None:
        """Note that the session has taken samples and found them good."""
        self._seen_s = self.clock()

    def crossed(self, what: str) -> None:
        """Note that a limit was crossed: the motor is stopped at the next turn."""
        self._crossed = what

    def check(self) -> None:
        """Raise what has ended the thread, if anything has."""
        if self._fault is not None:
            raise self._fault

    def halt(self) -> bool:
        """End the thread; what stands at the output is the caller's business. Never raises."""
        self._halted.set()
        if self._thread.is_alive():
            self._thread.join(_JOIN_S)
        return not self._thread.is_alive()

    def _run(self) -> None:
        due_s = self._start_s
        try:
            while not self._halted.wait(max(0.0, due_s - self.clock())):
                self._turn(due_s)
                due_s = max(due_s + self.update_s, self.clock())
        except BaseException as error:  # noqa: BLE001 - nothing may end this thread with a motor on
            self._zero()
            self._fault = _as_fault(error)

    def _turn(self, due_s: float) -> None:
        now_s = self.clock()
        self._check_session(now_s, now_s - due_s)
        device_s = self.speed * (now_s - self._start_s)
        since_s = self.speed * (now_s - self._written_s)
        value_v = self.reference.value_v(device_s, self._last_v, since_s)
        if value_v != self._last_v:
            self._write(value_v)
        self._written_s = now_s
        if now_s - self._fed_s >= self._feed_s:
            self.daq.feed_watchdog()
            self._fed_s = now_s

    def _check_session(self, now_s: float, late_s: float) -> None:
        if self._crossed:
            raise _fault(self._crossed, "find out why before raising the limit in the profile")
        if not now_s - self._seen_s <= _ABSENT_S:
            raise _fault(
                f"nobody has taken samples for {now_s - self._seen_s:.2f} s; allowed {_ABSENT_S} s",
                "look for what holds this computer up, then run again",
            )
        allowed_s = max(_LATE_S, _LATE_UPDATES * self.update_s)
        if not late_s <= allowed_s:
            raise _fault(
                f"a value of the motor reference came {late_s:.2f} s late; allowed {allowed_s:g} s",
                "free this computer of other work, then run again",
            )

    def _write(self, value_v: float) -> None:
        before_s = self.clock()
        found_v = self.daq.write_output("reference", value_v)
        self.log.add(before_s, self.clock(), found_v)
        self._last_v = value_v

    def _zero(self) -> None:
        """Put 0 V out; where that fails too, the watchdog does it, fed no more."""
        with suppress(Exception):
            self._write(0.0)


def _as_fault(error: BaseException) -> HdbenchError:
    if isinstance(error, HdbenchError):
        return error
    fault = _fault(
        f"the thread that makes it ended with {type(error).__name__}: {error}",
        "look at the device's connection, then run again with -v; if it stays, report it as a bug",
    )
    fault.__cause__ = error
    return fault


def _fault(what: str, fix: str) -> DeviceError:
    return DeviceError(what, where="motor reference", fix=fix)
