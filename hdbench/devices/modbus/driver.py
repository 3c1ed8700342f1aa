"""Driver of a polled Modbus device, described by its registers in the profile."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping

from hdbench.devices.bench import Identity, SafeState
from hdbench.devices.daq import (
    Capabilities,
    DaqSettings,
    OutputInfo,
    Role,
    ScanBlock,
    WatchdogInfo,
    WatchdogState,
)
from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.identity import check_identity
from hdbench.devices.modbus.inputs import Inputs, Polling, input_info
from hdbench.devices.modbus.layout import Block, place_of, plan_blocks
from hdbench.devices.modbus.outputs import Outputs, Watchdog, output_range_v, output_step_v
from hdbench.devices.registers import encode
from hdbench.devices.safestate import Seen, reach_safe_state
from hdbench.devices.wire.address import parse_address, serial_settings
from hdbench.errors import DeviceError, UsageError
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusWrite

# a request to read: function, address, count; a reply: function, byte count, data
_REQUEST, _REPLY_HEAD = 5, 2
# around both on a serial line: unit and checksum
_ENVELOPE = 3
# a slower poll than once in ten minutes is no acquisition
_MIN_RATE_HZ = 1.0 / 600.0
# while readings are taken, the watchdog's state is looked at this often, s
_LOOK_S = 0.1


def describe_abilities(table: ModbusAcquisition, *, simulated: bool) -> Capabilities:
    """Return the abilities."""
    output = table.output
    watchdog = None if output is None else output.watchdog
    write_s = 2.0 * exchange_s(table, 2)
    return Capabilities(
        inputs=tuple(input_info(table, channel) for channel in table.channels),
        max_rates_hz=max_rates_hz(table),
        min_rate_hz=_MIN_RATE_HZ,
        outputs=()
        if output is None
        else (OutputInfo("reference", *output_range_v(output), output_step_v(output), write_s),),
        generator=False,
        enable=output is not None and output.enable is not None,
        watchdog=None
        if watchdog is None
        else WatchdogInfo(
            watchdog.min_s,
            watchdog.max_s,
            watchdog.unit_s,
            watchdog.fed_by,
            watchdog.drops,
            watchdog.latches,
        ),
        simulated=simulated,
    )


def max_rates_hz(table: ModbusAcquisition) -> tuple[float, ...]:
    """Return the highest rate with the first 1, 2, ... channels, Hz.

    Notes
    -----
    One reading takes the time of its requests on the wire, the device's own time ``reply_s`` for
    each, and ``min_gap_s`` between them. What the motor reference takes of the line - a write and
    a read-back every ``update_s`` - is left out of it. A device that renews its values
    ``refresh_hz`` times per second is not polled more often: it would say the same twice.
    """
    output = table.output
    taken = 0.0 if output is None else 2.0 * exchange_s(table, 2) / output.update_s
    rates = []
    for count in range(1, len(table.channels) + 1):
        reading_s = sum(exchange_s(table, block.reply_bytes) for block in reads_of(table, count))
        rate = max(0.0, 1.0 - taken) / reading_s if reading_s > 0.0 else math.inf
        rates.append(min(rate, table.refresh_hz or math.inf))
    return tuple(rates)


def exchange_s(table: ModbusAcquisition, data_bytes: int) -> float:
    """Return the time of one request and its reply, s."""
    sent, received = _REQUEST + _ENVELOPE, _REPLY_HEAD + data_bytes + _ENVELOPE
    line, wire_s = None if table.serial is None else serial_settings(table.serial), 0.0
    if table.address != "embedded":
        address = parse_address(table.address, line, default_port=502)
        line = address.serial if address.is_line else None
        if address.scheme == "ascii":
            # two characters for a byte, a shorter checksum, and what frames them
            sent, received = 2 * sent + 1, 2 * received + 1
    if line is not None:
        wire_s = line.exchange_s(sent, received)
    return wire_s + table.reply_s + table.min_gap_s


def reads_of(table: ModbusAcquisition, count: int | None = None) -> tuple[Block, ...]:
    """Return the requests of one reading."""
    channels = table.channels[:count]
    places = [place_of(table, channel) for channel in channels]
    places += [place_of(table, w) for c in channels for w in (c.status, c.sign) if w is not None]
    return plan_blocks(places, most=table.max_read_registers, bridge=table.bridge_registers)


def set_up(access: Access, table: ModbusAcquisition) -> int:
    """Bring the device to the settings of ``[[daq.init]]``."""
    written = 0
    for write in table.init:
        place = place_of(table, write)
        if write.read_back and _same(write, access.read([place])[0]):
            continue
        access.write(place, write.value, write.function)
        written += 1
        if not write.read_back:
            continue
        found = access.read([place])[0]
        if not _same(write, found):
            raise DeviceError(
                f"reads back as {found:.9g}; written: {write.value:.9g}",
                where=f"{access.where}, {place.name}",
                fix="compare daq.init with the device's manual; a command register has "
                "read_back = false",
            )
    return written


def _same(write: ModbusWrite, found: float | int) -> bool:
    """Return whether a value is the one to be written, as its registers hold it."""
    if write.table == "coil":
        return bool(found) == bool(write.value)
    try:
        wanted = encode(write.value, write.type, "ABCD")
        return encode(found, write.type, "ABCD") == wanted
    except ValueError:
        return False


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
        outputs, output = self._outputs, self._table.output
        if outputs is None or output is None:
            return SafeState(True, None, None, "the device drives nothing")

        def stop() -> None:
            self.identity()
            outputs.zero()

        def disable() -> bool:
            self.identity()
            return outputs.switch_off()

        return reach_safe_state(
            stop=stop,
            look=lambda: Seen(outputs.read_back()),
            disable=disable,
            zero_v=outputs.zero_v,
            brake_s=output.brake_s,
            clock=self._clock,
            sleep=self._sleep,
        )

    def close(self) -> None:
        """Close the connection; never raises."""
        self._access.close()

    def _make_safe(self) -> None:
        if self._outputs is not None:
            self._outputs.make_safe()

    @property
    def _watchdog(self) -> Watchdog | None:
        return None if self._outputs is None else self._outputs.watchdog

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
