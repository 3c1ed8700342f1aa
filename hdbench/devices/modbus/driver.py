"""Driver of a polled Modbus device, described by its registers in the profile."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace

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
from hdbench.devices.driver import Driver, later
from hdbench.devices.guard.order import Check, Look, Target, target_at
from hdbench.devices.modbus.access import QUIET_S, TRY, Access
from hdbench.devices.modbus.identity import check_identity, make_probe
from hdbench.devices.modbus.inputs import Inputs, Polling, input_info
from hdbench.devices.modbus.layout import (
    Block,
    blocks_of,
    bounds,
    form_of,
    place_of,
    plan_blocks,
    write_request,
)
from hdbench.devices.modbus.outputs import Outputs, Watchdog, output_range_v, output_step_v
from hdbench.devices.registers import Register, encode
from hdbench.devices.safestate import Seen, reach_safe_state
from hdbench.devices.wire.address import parse_address, serial_settings
from hdbench.errors import DeviceError, ProfileError, UsageError
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusWrite
from hdbench.profile.schema import ProfileData

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
    inputs_only = Capabilities(
        inputs=tuple(input_info(table, channel) for channel in table.channels),
        max_rates_hz=max_rates_hz(table),
        min_rate_hz=_MIN_RATE_HZ,
        simulated=simulated,
    )
    output = table.output
    if output is None:
        return inputs_only
    dog, write_s = output.watchdog, 2.0 * exchange_s(table, 2)
    return replace(
        inputs_only,
        outputs=(OutputInfo("reference", *output_range_v(output), output_step_v(output), write_s),),
        enable=output.enable is not None,
        watchdog=None
        if dog is None
        else WatchdogInfo(dog.min_s, dog.max_s, dog.unit_s, dog.fed_by, dog.drops, dog.latches),
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
    return blocks_of(table, places)


def set_up(access: Access, table: ModbusAcquisition) -> None:
    """Bring the device to the settings of ``[[daq.init]]``."""
    for write in table.init:
        place = place_of(table, write)
        if write.read_back and _same(write, access.read([place])[0]):
            continue
        access.write(place, write.value, write.function)
        if not write.read_back:
            continue
        found = access.read([place])[0]
        if not _same(write, found):
            what = f"reads back as {found:.9g}; written: {write.value:.9g}"
            fix = "compare daq.init with the device's manual; a command register has "
            raise access.error(what, place.name, fix + "read_back = false")


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

    The device is owned by the driver from now on; `table` is ``[daq]`` of the profile, or one part
    of a composite.
    """

    def __init__(self, access: Access, table: ModbusAcquisition) -> None:
        self._access = access
        self.close = access.close
        self._table = table
        self._outputs = None if table.output is None else Outputs(access, table, table.output)
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
            inputs = Inputs(self._access, self._table, settings.roles)
            self._polling = Polling(inputs, settings)
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
        if self._watchdog is not None and not time.monotonic() - self._looked_s < _LOOK_S:
            self._looked_s = time.monotonic()
            self._tripped = self._watchdog.state().tripped
        return self._polling.next_block(tripped=self._tripped)

    def stop(self) -> None:
        """Poll no more."""
        if self._polling is not None:
            self._polling.stopped = True

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
        reading = Inputs(self._access, self._table, roles).read()
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
        )

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


# data of a reply stand behind function code and byte count
_DATA_AT = 2
# what still counts as zero where the output is a float, V
_ZERO_V = 1e-3


def open_modbus(profile: ProfileData, table: ModbusAcquisition) -> ModbusDaq:
    """Open the device; nothing is connected or written yet."""
    # pymodbus is loaded by those who open such a device alone
    from hdbench.devices.modbus.replies import polled_link

    given = None if table.serial is None else serial_settings(table.serial)
    address = parse_address(table.address, given, default_port=502)
    if not address.is_numbered:
        _check_deadline(table)
    probe = make_probe(table)
    link = polled_link(address, unit=table.unit, probe=probe, tls=table.tls)
    access = Access(
        link,
        table,
        probe=None if address.is_numbered else probe,
        numbered=address.is_numbered,
    )
    return ModbusDaq(access, table)


def modbus_rate_hz(table: ModbusAcquisition) -> float:
    """Return the highest rate of the profile's channels, Hz."""
    rates = max_rates_hz(table)
    return rates[-1] if rates else math.inf


def _check_deadline(table: ModbusAcquisition) -> None:
    """Refuse a deadline whose tries are too short: a quiet line, a probe, a read, a probe."""
    longest = max((block.reply_bytes for block in reads_of(table)), default=2)
    needed_s = (QUIET_S + 3.0 * exchange_s(table, longest)) / TRY
    if not table.deadline_s >= needed_s:
        raise ProfileError(
            f"{table.deadline_s:g} s; on this line a lost frame is got over within "
            f"{needed_s:.2g} s",
            where="key daq.deadline_s",
            fix=f"set it to {needed_s:.2g} s or more",
        )


def stop_target(_profile: ProfileData, table: ModbusAcquisition) -> Target | None:
    """Return how the outputs of a polled device are made safe."""
    if table.output is None:
        return None
    output = table.output
    given = None if table.serial is None else serial_settings(table.serial)
    place = place_of(table, output)
    back = place if output.read_back is None else place_of(table, output.read_back)
    zero, scale = -output.offset / output.scale, abs(output.scale)
    spread = (output_step_v(output) or _ZERO_V) / scale
    finals, final_looks = [], []
    if output.enable is not None:
        line, off = place_of(table, output.enable), float(output.enable.off)
        finals.append(write_request(line, off))
        final_looks.append(_look(line, "enable line", off, off))
    address = parse_address(table.address, given, default_port=502)
    return Target(
        target_at(address, table.unit, table.tls, rest_s=table.min_gap_s),
        acts=(write_request(place, zero, output.function),),
        looks=(_look(back, "motor reference, steps", zero - spread, zero + spread),),
        identity=tuple(
            _look(where := place_of(table, rule), where.name, *bounds(rule), rule.mask or 0)
            for rule in table.identify
        ),
        finals=tuple(finals),
        final_looks=tuple(final_looks),
        brake_s=output.brake_s,
    )


def _look(place: Register, name: str, low: float, high: float, mask: int = 0) -> Look:
    """Return a read of one value that must lie between two others."""
    (block,) = plan_blocks([place], most=place.size, bridge=0)
    form, order, mask = (">B", (), 1) if place.is_bit else (*form_of(place), mask)
    return Look(block.request(), (Check(name, _DATA_AT, form, low, high, mask, order),))


DRIVER = Driver(
    open=open_modbus,
    rate_hz=modbus_rate_hz,
    drives=lambda table: table.output is not None,
    stop_target=stop_target,
    emulate=later("hdbench.devices.emulator.modbus:emulate_modbus"),
)
