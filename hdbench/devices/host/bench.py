"""Host bench: a `Bench` made of a `Daq`."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hdbench.devices.bench import AcquisitionSettings, Block, Identity, SafeState
from hdbench.devices.daq import Capabilities, Daq, DaqSettings, repeats_of
from hdbench.devices.feasibility import check_demands
from hdbench.devices.host.channels import ChannelMap, SampleClock
from hdbench.devices.host.control import ControlThread, HostReference, ReferenceLog
from hdbench.devices.host.settings import HostSettings, crossed_limit
from hdbench.devices.safestate import confirm_safe, wait_for_standstill
from hdbench.errors import DeviceError, HdbenchError
from hdbench.records.trace import FloatArray


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
    """

    def __init__(
        self,
        daq: Daq,
        settings: HostSettings,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
        speed: float = 1.0,
    ) -> None:
        self.daq = daq
        self._settings = settings
        self._clock = clock
        self._sleep = sleep
        self._speed = speed
        self._asked: AcquisitionSettings | None = None
        self._reference: HostReference | None = None
        self._control: ControlThread | None = None
        self._log: ReferenceLog | None = None
        self._channels: ChannelMap | None = None
        self._samples: SampleClock | None = None
        self._start_s = 0.0

    def capabilities(self) -> Capabilities:
        """Return what the device can do."""
        return self.daq.capabilities()

    def identity(self) -> Identity:
        """Return who answers."""
        return self.daq.identity()

    def claim(self) -> None:
        """Become the one host that may write; raises `BusyError` if another one holds it."""
        self.daq.claim()

    def configure(self, settings: AcquisitionSettings) -> None:
        """Check what is asked against what the device can, write it, and read it back."""
        able = self.daq.capabilities()
        check_demands(settings, self._settings, able)
        self._asked, self._reference = settings, None
        made_here = settings.reference is not None and not able.generator
        if made_here and settings.reference is not None:
            self._reference = HostReference(
                settings.reference,
                settings.sample_period_s,
                settings.n_samples,
                limit_v=self._settings.limit_v,
                slew_v_per_s=self._settings.slew_v_per_s,
            )
        period_s = self.daq.configure(
            DaqSettings(
                roles=self._settings.roles,
                sample_period_s=settings.sample_period_s,
                n_samples=settings.n_samples,
                watchdog_s=self._settings.watchdog_s,
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

    def start(self) -> None:
        """Start sampling and, with a reference, the motion."""
        asked = self._asked
        if asked is None:
            raise DeviceError(
                "no acquisition is configured", where="bench", fix="configure it first"
            )
        if self._reference is not None:
            self.daq.arm_watchdog(self._settings.watchdog_s)
            self.daq.write_output("reference", 0.0)
            self.daq.enable(on=True)
            self.daq.feed_watchdog()
        before_s = self._clock()
        self.daq.start()
        self._start_s = after_s = self._clock()
        self._samples = SampleClock(asked.sample_period_s / self._speed, before_s, after_s)
        self._log = ReferenceLog(before_s, 0.0)
        able = self.daq.capabilities()
        written = None if able.generator or not able.drives else self._written
        self._channels = ChannelMap(self._settings.roles, able, written)
        if self._reference is not None:
            self._control = ControlThread(
                self.daq,
                self._reference,
                self._log,
                update_s=self._settings.update_s,
                watchdog_s=self._settings.watchdog_s,
                clock=self._clock,
                speed=self._speed,
            )
            self._control.start(after_s)

    def read_block(self) -> Block | None:
        """Return the next samples; None when none is ready yet."""
        if self._channels is None or self._samples is None:
            raise DeviceError(
                "no acquisition has been started", where="bench", fix="start it first"
            )
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
            crossed = self._doubt() or (crossed_limit(block, self._settings) if block else "")
            if crossed:
                control.crossed(crossed)
            control.seen()
        return block

    def stop(self) -> None:
        """Stop normally: reference zero, standstill, enable off; then sampling ends."""
        control = self._control
        if control is None:
            self.daq.stop()
            return
        if not control.halt():
            raise DeviceError(
                "a write to the motor reference does not end",
                where="bench",
                fix="look at the device's connection, then run again",
            )
        self._control = None
        self.daq.write_output("reference", 0.0)
        self.daq.feed_watchdog()
        self.daq.stop()
        _, moving = wait_for_standstill(self.daq, self._settings, self._clock, self._feeding_sleep)
        self.daq.enable(on=False)
        self.daq.clear_watchdog()
        if moving:
            raise DeviceError(
                f"after the stop {moving}", where="bench", fix="press the emergency stop and look"
            )
        control.check()

    def fall_silent(self) -> None:
        """Leave the motor to the device's watchdog: no value, no stop, no sign of life from here.

        For the proof of the watchdog alone; `safe_state` ends it.
        """
        if self._control is not None:
            self._control.halt()

    def safe_state(self) -> SafeState:
        """Make the bench safe from any state; never raises."""
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
        if not drives:
            return safe
        return confirm_safe(safe, self.daq, self._settings, self._clock, self._sleep)

    def close(self) -> None:
        """Close the connection; never raises."""
        if self._control is not None:
            self._control.halt()
        self.daq.close()

    def _doubt(self) -> str:
        """Return that samples and reference cannot be put on one clock; empty where they can."""
        doubt_s = self._samples.doubt_s if self._samples is not None else 0.0
        if doubt_s <= self._settings.max_skew_s:
            return ""
        return (
            f"the samples' times are in doubt by {doubt_s:.3f} s against the motor reference; "
            f"allowed {self._settings.max_skew_s:g} s"
        )

    def _feeding_sleep(self, seconds: float) -> None:
        """Keep the watchdog fed while the motor comes to rest under the drive's control."""
        self.daq.feed_watchdog()
        self._sleep(seconds)

    def _written(self, first_index: int, n: int) -> FloatArray:
        """Return the reference that stood at n samples, V, as it was written and read back."""
        if self._log is None or self._samples is None:
            return np.full(n, np.nan)
        index = np.arange(first_index, first_index + n, dtype=np.float64)
        times_s: FloatArray = self._samples.offset_s + index * (self._period_s / self._speed)
        return self._log.at(times_s)

    @property
    def _period_s(self) -> float:
        return self._asked.sample_period_s if self._asked else 0.0
