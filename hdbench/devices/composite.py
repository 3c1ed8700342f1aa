"""Composite device: inputs of one DAQ and outputs of another as one."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace

from hdbench.devices import daq
from hdbench.devices.bench import Identity, SafeState
from hdbench.devices.driver import Driver, driver_of, open_daq
from hdbench.errors import DeviceError
from hdbench.profile.acquiring import CompositeAcquisition
from hdbench.profile.schema import ProfileData

# how often the outputs' watchdog is looked at while samples come
_LOOK_S = 0.1


class CompositeDaq:
    """Implements `hdbench.devices.daq.Daq` on two others.

    Parameters
    ----------
    inputs : Daq
        Samples; its sample clock is the clock of the run.
    outputs : Daq
        Has reference, enable line and watchdog.
    clock : callable, optional
        Monotonic clock, s.

    Notes
    -----
    The outputs have no sample clock. What is written to them is timed by this computer's monotonic
    clock, on which the inputs' samples are placed by `hdbench.devices.host.SampleClock`: the
    doubt is half of the time of a write and half of what start and arrivals leave open.
    """

    def __init__(
        self, inputs: daq.Daq, outputs: daq.Daq, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._inputs = inputs
        self._outputs = outputs
        self._clock = clock
        self._looked_s = 0.0
        self._tripped = False
        self.start, self.stop = inputs.start, inputs.stop
        self.write_output, self.enable = outputs.write_output, outputs.enable
        self.arm_watchdog, self.feed_watchdog = outputs.arm_watchdog, outputs.feed_watchdog
        self.watchdog, self.clear_watchdog = outputs.watchdog, outputs.clear_watchdog

    @property
    def repeats(self) -> int:
        """Requests that were sent again so far, by either device."""
        return daq.repeats_of(self._inputs) + daq.repeats_of(self._outputs)

    def capabilities(self) -> daq.Capabilities:
        """Return the inputs of the one, and outputs, enable and watchdog of the other.

        Raises
        ------
        DeviceError
            If the device that drives makes its reference itself, on a sample clock of its own.
        """
        inputs, outputs = self._inputs.capabilities(), self._outputs.capabilities()
        if outputs.generator:
            raise DeviceError(
                "the device that drives makes its reference itself, on a sample clock of its own",
                where="key daq.outputs.driver",
                fix="name a device whose output the host writes, or use that device alone",
            )
        return replace(
            inputs,
            reference=outputs.reference,
            enable=outputs.enable,
            watchdog=outputs.watchdog,
        )

    def identity(self) -> Identity:
        """Return both names; simulated only where both are."""
        one, other = self._inputs.identity(), self._outputs.identity()
        if one.simulated != other.simulated:
            raise DeviceError(
                f"{one.model} is {_kind(one)} and {other.model} is {_kind(other)}",
                where="keys daq.inputs and daq.outputs",
                fix="name two real devices, or two emulated ones",
            )
        names = ("vendor", "model", "serial", "firmware")
        both = {name: f"{getattr(one, name)} + {getattr(other, name)}" for name in names}
        return Identity(**both, simulated=one.simulated)

    def claim(self) -> None:
        """Take both, the one that moves first."""
        self.identity()
        self._outputs.claim()
        self._inputs.claim()

    def configure(self, settings: daq.DaqSettings) -> float:
        """Configure both; the outputs sample nothing."""
        self._outputs.configure(replace(settings, roles=(), reference=None))
        self._tripped = False
        return self._inputs.configure(replace(settings, reference=None))

    def read_block(self) -> daq.ScanBlock | None:
        """Return the inputs' next block, with the state of the outputs' watchdog."""
        block = self._inputs.read_block()
        now_s = self._clock()
        if not now_s - self._looked_s < _LOOK_S:
            self._tripped = self._outputs.watchdog().tripped
            self._looked_s = now_s
        if block is None or not self._tripped:
            return block
        return replace(block, watchdog_tripped=True)

    def snapshot(self) -> Mapping[daq.Role, float]:
        """Return what either device reads at this moment; the inputs' value where both do."""
        return {**self._outputs.snapshot(), **self._inputs.snapshot()}

    def safe_state(self) -> SafeState:
        """Make the outputs safe first, then stop sampling; never raises."""
        safe = self._outputs.safe_state()
        inputs = self._inputs.safe_state()
        if safe.confirmed and not inputs.confirmed:
            # the motor's outputs are safe; what the inputs do moves nothing
            return replace(safe, detail=f"{safe.detail}; the inputs: {inputs.detail}")
        return safe

    def close(self) -> None:
        """Close both; never raises."""
        self._outputs.close()
        self._inputs.close()


def _kind(identity: Identity) -> str:
    return "simulated" if identity.simulated else "real"


def open_composite(profile: ProfileData, table: CompositeAcquisition) -> CompositeDaq:
    """Return the driver of both devices."""
    inputs = open_daq(profile, table.inputs)
    try:
        outputs = open_daq(profile, table.outputs)
    except BaseException:
        inputs.close()
        raise
    return CompositeDaq(inputs, outputs)


DRIVER = Driver(
    open=open_composite,
    rate_hz=lambda table: driver_of(table.inputs.driver).rate_hz(table.inputs),
    drives=lambda table: driver_of(table.outputs.driver).drives(table.outputs),
)
