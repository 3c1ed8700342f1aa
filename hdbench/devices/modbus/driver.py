"""Any polled Modbus device as `hdbench.devices.daq.Daq`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from hdbench.devices.capabilities import Capabilities, Role
from hdbench.devices.daq import DaqSettings, ScanBlock, WatchdogState
from hdbench.devices.modbus.abilities import describe_abilities
from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.identity import check_identity
from hdbench.devices.modbus.inputs import Inputs
from hdbench.devices.modbus.outputs import Outputs, output_step_v
from hdbench.devices.modbus.polling import Polling
from hdbench.devices.modbus.safe import switch_off, zero
from hdbench.devices.modbus.setup import set_up
from hdbench.devices.modbus.watchdog import Watchdog
from hdbench.devices.ports import Identity, SafeState
from hdbench.devices.safestate import SafeActs, Seen, reach_safe_state
from hdbench.errors import DeviceError, UsageError
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusOutput

__all__ = ["ModbusDaq"]

# while readings are taken, the watchdog's state is looked at this often, s
_LOOK_S = 0.1


class ModbusDaq:
    """Driver of one device; implements `hdbench.devices.daq.Daq`.

    Parameters
    ----------
    access : Access
        The device; owned by the driver from now on.
    table : ModbusAcquisition
        ``[daq]`` of the profile, or one part of a composite.
    clock, sleep : callable, optional
        Monotonic clock in s, and waiting.
    """

    def __init__(
        self,
        access: Access,
        table: ModbusAcquisition,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._access = access
        self._table = table
        self._clock = clock
        self._sleep = sleep
        output = table.output
        self._outputs = None if output is None else Outputs(access, table, output)
        spec = None if output is None else output.watchdog
        self._watchdog = None if spec is None else Watchdog(access, table, spec)
        self._identity: Identity | None = None
        self._polling: Polling | None = None
        self._tripped = False
        self._looked_s = 0.0

    @property
    def repeats(self) -> int:
        """Requests that were sent again so far."""
        return self._access.repeats

    def capabilities(self) -> Capabilities:
        """Return what the device can do as the profile describes it."""
        return describe_abilities(self._table, simulated=self.identity().simulated)

    def identity(self) -> Identity:
        """Return who answers; asked once, before anything is written."""
        if self._identity is None:
            self._identity = check_identity(self._access, self._table)
        return self._identity

    def claim(self) -> None:
        """Check who answers: Modbus knows no sessions, so hosts on other machines are not seen."""
        self.identity()

    def configure(self, settings: DaqSettings) -> float:
        """Make the outputs safe, write settings that differ, and return the sample period, s."""
        self.identity()
        self._polling = None
        self._tripped = False
        self._make_safe()
        set_up(self._access, self._table)
        if settings.roles:
            inputs = Inputs(self._access, self._table, settings.roles, self._clock)
            self._polling = Polling(
                inputs,
                len(settings.roles),
                settings.n_samples,
                settings.sample_period_s,
                self._clock,
                self._sleep,
            )
        return settings.sample_period_s

    def start(self) -> None:
        """Begin to poll; a device without channels has nothing to start."""
        if self._polling is None:
            raise self._error("no acquisition is configured", "configure it first")
        self._polling.start()

    def read_block(self) -> ScanBlock | None:
        """Return the next reading; None when none is due yet, or the device had none."""
        if self._polling is None or not self._polling.started:
            raise self._error("no acquisition has been started", "start it first")
        if self._watchdog is not None and not self._clock() - self._looked_s < _LOOK_S:
            self._looked_s = self._clock()
            self._tripped = self._watchdog.state().tripped
        return self._polling.next_block(tripped=self._tripped)

    def stop(self) -> None:
        """Poll no more."""
        if self._polling is not None:
            self._polling.stop()

    def write_output(self, name: str, value: float) -> float:
        """Write the motor reference once and return what is read back, V."""
        if name != "reference":
            raise UsageError(
                f"no output {name!r}; a Modbus table has one, reference",
                where=self._access.where,
                fix="name the output reference",
            )
        return self._driving().write(value)

    def enable(self, *, on: bool) -> bool:
        """Switch the drive's enable line and return what is read back."""
        return self._driving().enable(on=on)

    def arm_watchdog(self, time_s: float) -> float:
        """Set its time where it differs, clear a trip, feed it, and return its time, s."""
        return self._guard().arm(time_s)

    def feed_watchdog(self) -> None:
        """Feed it once."""
        self._guard().feed()

    def watchdog(self) -> WatchdogState:
        """Return its state as read from the device; not armed where there is none."""
        if self._watchdog is None:
            return WatchdogState(armed=False, tripped=False, time_s=0.0)
        return self._watchdog.state()

    def clear_watchdog(self) -> None:
        """Make the outputs safe, then clear a trip."""
        self._make_safe()
        if self._watchdog is not None:
            self._watchdog.clear()

    def snapshot(self) -> Mapping[Role, float]:
        """Return one reading of every channel; empty where there is none, or it is invalid."""
        roles = tuple(channel.role for channel in self._table.channels)
        if not roles:
            return {}
        reading = Inputs(self._access, self._table, roles, self._clock).read()
        return {} if reading.doubt else dict(zip(roles, reading.values, strict=True))

    def safe_state(self) -> SafeState:
        """Bring the reference to zero and the enable off, read back twice; never raises.

        Notes
        -----
        Another device at this address is never written to: the safe state is not confirmed then.
        """
        self._polling = None
        output = self._table.output
        if self._outputs is None or output is None:
            return SafeState(True, None, None, "the device drives nothing")
        outputs = self._outputs
        zero_v = _zero_v(output)

        def stop() -> None:
            self.identity()
            zero(outputs, self._watchdog, zero_v)

        def disable() -> bool:
            self.identity()
            return not switch_off(outputs, self._watchdog)

        acts = SafeActs(
            stop=stop,
            look=lambda: Seen(outputs.read_back()),
            disable=disable,
            zero_v=zero_v,
            brake_s=output.brake_s,
        )
        return reach_safe_state(acts, self._clock, self._sleep)

    def close(self) -> None:
        """Close the connection; never raises."""
        self._access.close()

    def _make_safe(self) -> None:
        outputs, output = self._outputs, self._table.output
        if outputs is None or output is None:
            return
        zero(outputs, self._watchdog, _zero_v(output))
        if switch_off(outputs, self._watchdog):
            raise self._error(
                "the enable line reads back as on after it was switched off",
                "use the emergency stop, then check daq.output.enable",
            )

    def _driving(self) -> Outputs:
        if self._outputs is None:
            raise self._error("the profile names no output", "add [daq.output]")
        return self._outputs

    def _guard(self) -> Watchdog:
        if self._watchdog is None:
            raise self._error(
                "the profile names no watchdog", "add [daq.output.watchdog], or drive nothing"
            )
        return self._watchdog

    def _error(self, what: str, fix: str) -> DeviceError:
        return DeviceError(what, where=self._access.where, fix=fix)


def _zero_v(output: ModbusOutput) -> float:
    """Return what still counts as zero, V: one step; of a float, less than moves any motor."""
    return max(output_step_v(output), 1e-6)
