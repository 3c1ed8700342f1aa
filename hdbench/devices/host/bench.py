"""Host bench: a `Bench` made of a `Daq`, its channels and their times."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.bench import AcquisitionSettings, Block, SafeState, crossed_limit, scaled
from hdbench.devices.daq import (
    ROLE_UNITS,
    Capabilities,
    Daq,
    DaqSettings,
    Role,
    ScanBlock,
    repeats_of,
)
from hdbench.devices.feasibility import HostSettings, check_demands
from hdbench.devices.host.control import ControlThread, HostReference, ReferenceLog
from hdbench.devices.safestate import wait_for_standstill
from hdbench.errors import DeviceError, HdbenchError
from hdbench.records.trace import FloatArray

if TYPE_CHECKING:
    from hdbench.devices.guard.session import GuardProcess, Watch
    from hdbench.devices.operator import Simulation

# at the end of its range the amplifier limits the current, not the converter; a count has no end
_CONVERTED: tuple[Role, ...] = ("torque", "tacho", "reference")
References = Callable[[int, int], FloatArray]
"""Gives the reference that stood at n samples from an index on, V."""
# the earliest arrival of this many blocks follows a drifting device clock
_WINDOW = 64


class Unwrap:
    """Counts without wraps, from block to block.

    Parameters
    ----------
    wrap : int
        Period of the counter, counts; 0 for one that does not wrap.

    Notes
    -----
    Between two samples, lost ones included, the motor makes less than half of a period.
    """

    def __init__(self, wrap: int) -> None:
        self._wrap = wrap
        self._last: NDArray[np.int64] | None = None

    def __call__(self, raw: FloatArray) -> NDArray[np.int64]:
        """Return the counts of the next samples."""
        counts = np.asarray(raw, dtype=np.int64)
        if len(counts) == 0 or not self._wrap:
            return counts
        before = counts[:1] if self._last is None else self._last
        total = np.unwrap(np.append(before, counts), period=self._wrap)[1:].astype(np.int64)
        self._last = total[-1:]
        return total


class ChannelMap:
    """Turns the scans of one acquisition into blocks of a bench.

    Parameters
    ----------
    roles : tuple of Role
        Channels of a scan, in order.
    capabilities : Capabilities
        Of the device, for the period of its counter.
    references : callable or None
        What the host wrote, for a device that does not measure the reference itself.
    """

    def __init__(
        self,
        roles: tuple[Role, ...],
        capabilities: Capabilities,
        references: References | None = None,
    ) -> None:
        self._column = {role: index for index, role in enumerate(roles)}
        counter = capabilities.input("encoder")
        self._unwrap = Unwrap(counter.wrap if counter else 0)
        self._references = references
        self._absent = tuple(
            role
            for role in ROLE_UNITS
            if role not in self._column and (role != "reference" or references is None)
        )
        self._converted = [self._column[role] for role in _CONVERTED if role in self._column]

    def block(self, scans: ScanBlock, start_s: float, repeats: int = 0) -> Block:
        """Return the scans as a block; channels that are not sampled are NaN, their counts 0."""
        n = len(scans)
        reference = self._values(scans, "reference")
        if "reference" not in self._column and self._references is not None:
            reference = self._references(scans.first_index, n)
        counts = np.zeros(n, dtype=np.int64)
        if "encoder" in self._column:
            counts = self._unwrap(self._values(scans, "encoder"))
        return Block(
            first_index=scans.first_index,
            lost_before=scans.lost_before,
            torque_v=self._values(scans, "torque"),
            tacho_v=self._values(scans, "tacho"),
            motor_current_a=self._values(scans, "current"),
            reference_v=reference,
            encoder_count=counts,
            saturated=np.any(scans.saturated[:, self._converted], axis=1),
            running=scans.running,
            watchdog_tripped=scans.watchdog_tripped,
            depth=scans.depth,
            time_s=None if scans.time_s is None else scans.time_s - start_s,
            absent=self._absent,
            repeats=repeats,
        )

    def _values(self, scans: ScanBlock, role: Role) -> FloatArray:
        column = self._column.get(role)
        if column is None:
            return np.full(len(scans), np.nan)
        return scans.values[:, column]


class SampleClock:
    """Places sample k at ``offset + k * period`` on the host's monotonic clock.

    Parameters
    ----------
    period_s : float
        Sampling period, s.
    before_s, after_s : float
        Host's clock before and after the call that started the acquisition, s.

    Notes
    -----
    Sample 0 was taken after the start was asked for. Sample k was taken before the reply that
    brought it: every block gives a bound, and the tightest of the last 64 one that follows the
    drift of the device's clock. The offset lies between these two bounds; it is taken in the
    middle, with half of their distance as its doubt (limits of a rectangular distribution).
    """

    def __init__(self, period_s: float, before_s: float, after_s: float) -> None:
        self._period_s = period_s
        self._low_s = before_s
        self._high_s = after_s + period_s
        self._first_bound_s = math.inf
        self._bounds_s: deque[float] = deque(maxlen=_WINDOW)

    @property
    def offset_s(self) -> float:
        """Host time of sample 0, s."""
        full = len(self._bounds_s) == _WINDOW
        drift_s = min(self._bounds_s) - self._first_bound_s if full else 0.0
        return 0.5 * (self._low_s + self._high_s) + drift_s

    @property
    def doubt_s(self) -> float:
        """Half of the distance of its bounds, s."""
        return 0.5 * (self._high_s - self._low_s)

    def times_s(self, first_index: int, n: int) -> FloatArray:
        """Return the host's time of n samples, s."""
        index = np.arange(first_index, first_index + n, dtype=np.float64)
        return self.offset_s + index * self._period_s

    def seen(self, newest: int, read_s: float) -> None:
        """Note that sample `newest` was in a reply that ended at `read_s`."""
        bound_s = read_s - newest * self._period_s
        self._bounds_s.append(bound_s)
        if len(self._bounds_s) < _WINDOW or not math.isfinite(self._first_bound_s):
            self._high_s = max(self._low_s, min(self._high_s, bound_s))
        if len(self._bounds_s) == _WINDOW and not math.isfinite(self._first_bound_s):
            self._first_bound_s = min(self._bounds_s)


@dataclass(eq=False)
class HostedBench:
    """Implements `hdbench.devices.bench.Bench` on any DAQ.

    Parameters
    ----------
    daq : Daq
        The device, or a composite; owned by the bench from now on.
    settings : HostSettings
        What the profile says.
    clock, sleep : callable, optional
        Monotonic clock in s, and waiting.
    speed : float, optional
        Device seconds per second; other than 1 for an accelerated emulator only.
    start_guard : callable, optional
        Starts a guard, once, when the first motion is configured; it lives until the safe state.
    simulation : Simulation, optional
        Control channel of a simulated bench; whatever the device says, without it it is a real one.
    """

    daq: Daq
    settings: HostSettings
    _: KW_ONLY
    start_guard: Callable[[], GuardProcess | None] = lambda: None
    simulation: Simulation | None = None
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    speed: float = 1.0

    def __post_init__(self) -> None:
        daq = self.daq
        self.capabilities, self.identity, self.claim = daq.capabilities, daq.identity, daq.claim
        self._asked: AcquisitionSettings | None = None
        self._reference: HostReference | None = None
        self._control: ControlThread | None = None
        self._channels: ChannelMap | None = None
        self._samples: SampleClock | None = None
        self._start_s = 0.0
        self.guard: GuardProcess | None = None
        self._moves = False

    def configure(self, settings: AcquisitionSettings) -> None:
        """Check what is asked against what the device can, write it, and read it back.

        Before the first motion the guard is started.
        """
        able = self.daq.capabilities()
        check_demands(settings, self.settings, able)
        self._asked, self._reference = settings, None
        if settings.reference is not None and not able.generator:
            output = self.settings.output
            self._reference = HostReference(
                settings.reference,
                settings.sample_period_s,
                settings.n_samples,
                limit_v=min(output.limit_v, self.settings.profile.limits.reference_v),
                slew_v_per_s=output.slew_v_per_s,
            )
        period_s = self.daq.configure(
            DaqSettings(
                roles=self.settings.roles,
                sample_period_s=settings.sample_period_s,
                n_samples=settings.n_samples,
                watchdog_s=self.settings.watchdog_s,
                reference=settings.reference if able.generator else None,
            )
        )
        # times in a trace are counts of this period: 100 ppm are 60 ms in ten minutes
        if not abs(period_s - settings.sample_period_s) <= 1e-4 * settings.sample_period_s:
            raise DeviceError(
                f"the device samples every {period_s:.9g} s; asked for "
                f"{settings.sample_period_s:.9g} s",
                where="key daq.sample_period_s",
                fix="choose a period that the device's clock divides into",
            )
        self._moves = settings.reference is not None
        if self._moves and self.guard is None:
            self.guard = self.start_guard()

    def start(self) -> None:
        """Start sampling and, with a reference, the motion under the guard's eyes."""
        asked = self._asked
        if asked is None:
            raise _fault("no acquisition is configured", "configure it first")
        self._watch("patiently")
        if self._reference is not None:
            self.daq.arm_watchdog(self.settings.watchdog_s)
            self.daq.write_output("reference", 0.0)
            self.daq.enable(on=True)
            self.daq.feed_watchdog()
        before_s = self.clock()
        self.daq.start()
        self._start_s = after_s = self.clock()
        samples = SampleClock(asked.sample_period_s / self.speed, before_s, after_s)
        # as it was written and read back
        log = ReferenceLog(before_s, 0.0)
        able = self.daq.capabilities()

        def references(first_index: int, n: int) -> FloatArray:
            return log.at(samples.times_s(first_index, n))

        written = able.drives and not able.generator
        self._channels = ChannelMap(self.settings.roles, able, references if written else None)
        self._samples = samples
        if self._reference is not None:
            self._control = ControlThread(
                self.daq,
                self._reference,
                log,
                update_s=self.settings.output.update_s,
                watchdog_s=self.settings.watchdog_s,
                clock=self.clock,
                speed=self.speed,
            )
            self._control.start(after_s)
        self._watch("closely")

    def read_block(self) -> Block | None:
        """Return the next samples; None when none is ready yet. Each return is a sign of life."""
        try:
            block = self._read()
        except DeviceError:
            if self.guard is not None:
                # what the device refuses may be the guard's doing: then this raises
                self.guard.check()
            raise
        if self.guard is not None:
            self.guard.beat()
        return block

    def _read(self) -> Block | None:
        if self._channels is None or self._samples is None:
            raise _fault("no acquisition has been started", "start it first")
        control = self._control
        if control is not None:
            control.check()
        scans = self.daq.read_block()
        if scans is not None and len(scans):
            self._samples.seen(scans.first_index + len(scans) - 1, scans.read_s[1])
        block = None
        if scans is not None:
            block = self._channels.block(scans, self._start_s, repeats_of(self.daq))
        if control is not None:
            crossed = self._doubt() or self._crossed(block)
            if crossed:
                control.crossed(crossed)
            control.seen()
        return block

    def stop(self) -> None:
        """Stop normally: reference zero, standstill, enable off; then sampling ends."""
        self._watch("patiently")
        self._halt()
        self._watch("end-only")

    def _halt(self) -> None:
        control = self._control
        if control is None:
            self.daq.stop()
            return
        if not control.halt():
            fix = "look at the device's connection, then run again"
            raise _fault("a write to the motor reference does not end", fix)
        self._control = None
        self.daq.write_output("reference", 0.0)
        self.daq.feed_watchdog()
        self.daq.stop()
        _, moving = self._standstill(self._feeding_sleep)
        self.daq.enable(on=False)
        self.daq.clear_watchdog()
        if moving:
            raise _fault(f"after the stop {moving}", "press the emergency stop and look")
        control.check()

    def fall_silent(self) -> None:
        """Leave the motor to the device's watchdog: no value, no stop, no sign of life from here.

        For the proof of the watchdog alone; `safe_state` ends it.
        """
        if self._control is not None:
            self._control.halt()

    def safe_state(self) -> SafeState:
        """Make the bench safe from any state; the guard goes once that is confirmed.

        Never raises.
        """
        try:
            if self.guard is not None:
                self.guard.watch("patiently")
        except DeviceError:
            # what it has to say was said, or will be, elsewhere; the motor comes first
            self._moves = False
        safe = self._made_safe()
        if safe.confirmed and self.guard is not None:
            self.guard.end()
            self.guard = None
        return safe

    def _made_safe(self) -> SafeState:
        control, self._control = self._control, None
        self._asked, self._channels = None, None
        ended = control is None or control.halt()
        safe = self.daq.safe_state()
        if control is not None and not ended:
            # the last value of a write that hung may have come after the zero
            ended = control.halt()
            safe = self.daq.safe_state()
            if not ended:
                safe = replace(safe, confirmed=False, detail="a write to the reference hangs")
        try:
            drives = self.daq.capabilities().drives
        except HdbenchError:
            drives = True
        if not drives or not safe.confirmed or safe.velocity_rad_s is not None:
            return safe
        # the device has not looked itself whether the motor stands
        speed, why = self._standstill(self.sleep)
        detail = why or f"{safe.detail}, motor standing"
        return replace(safe, confirmed=not why, velocity_rad_s=speed, detail=detail)

    def close(self) -> None:
        """Close the connection; a guard that is still there stops the motor. Never raises."""
        if self._control is not None:
            self._control.halt()
        self.daq.close()
        if self.guard is not None:
            self.guard.abandon()
            self.guard = None

    def _watch(self, how: Watch) -> None:
        """Say to the guard of a motion how closely it is to watch from now on."""
        if self.guard is not None and self._moves:
            self.guard.watch(how)

    def _standstill(self, sleep: Callable[[float], None]) -> tuple[float | None, str]:
        return wait_for_standstill(self.daq, self.settings.profile, self.clock, sleep)

    def _doubt(self) -> str:
        """Return that samples and reference cannot be put on one clock; empty where they can."""
        doubt_s = self._samples.doubt_s if self._samples is not None else 0.0
        if doubt_s <= self.settings.max_skew_s:
            return ""
        return (
            f"the samples' times are in doubt by {doubt_s:.3f} s against the motor reference; "
            f"allowed {self.settings.max_skew_s:g} s"
        )

    def _crossed(self, block: Block | None) -> str:
        """Return which limit the newest samples have crossed."""
        if block is None:
            return ""
        profile = self.settings.profile
        rows = scaled(block, profile, profile.sensor.gain_nm_per_v)
        what, sample = crossed_limit(block, rows, profile.limits) or ("", 0)
        return what and f"{what} at sample {sample}"

    def _feeding_sleep(self, seconds: float) -> None:
        """Keep the watchdog fed while the motor comes to rest under the drive's control."""
        self.daq.feed_watchdog()
        self.sleep(seconds)


def _fault(what: str, fix: str) -> DeviceError:
    return DeviceError(what, where="bench", fix=fix)
