"""Driver of a polled Modbus device, described by its registers in the profile."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

from hdbench.devices import daq
from hdbench.devices.base import DeviceBase
from hdbench.devices.bench import Identity
from hdbench.devices.driver import Driver, later
from hdbench.devices.guard.order import Check, Look, Target, target_at
from hdbench.devices.modbus import layout
from hdbench.devices.modbus.access import QUIET_S, TRY, Access
from hdbench.devices.modbus.identity import check_identity, make_probe
from hdbench.devices.modbus.inputs import Inputs, Polling, input_info
from hdbench.devices.modbus.outputs import Outputs, output_step_v
from hdbench.devices.registers import Register, encode
from hdbench.devices.wire.address import address_of, serial_settings
from hdbench.errors import ProfileError
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
        address = address_of(table, default_port=502)
        line = address.serial if address.is_line else None
        if address.scheme == "ascii":
            # two characters for a byte, a shorter checksum, and what frames them
            sent, received = 2 * sent + 1, 2 * received + 1
    if line is not None:
        wire_s = line.exchange_s(sent, received)
    return wire_s + table.reply_s + table.min_gap_s


def reads_of(table: ModbusAcquisition, count: int | None = None) -> tuple[layout.Block, ...]:
    """Return the requests of one reading."""
    channels = table.channels[:count]
    places = [layout.place_of(table, channel) for channel in channels]
    places += [
        layout.place_of(table, w) for c in channels for w in (c.status, c.sign) if w is not None
    ]
    return layout.blocks_of(table, places)


def set_up(access: Access, table: ModbusAcquisition) -> None:
    """Bring the device to the settings of ``[[daq.init]]``."""
    for write in table.init:
        place = layout.place_of(table, write)
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


class ModbusDaq(DeviceBase[Polling]):
    """Driver of one device; implements `hdbench.devices.daq.Daq`.

    The device is owned by the driver from now on; `table` is ``[daq]`` of the profile, or one part
    of a composite.
    """

    def __init__(self, access: Access, table: ModbusAcquisition) -> None:
        outputs = None if table.output is None else Outputs(access, table, table.output)
        super().__init__(access.where, outputs, access)
        self._access = access
        self.close = access.close
        self._table = table
        self._tripped = False
        self._looked_s = 0.0

    def capabilities(self) -> daq.Capabilities:
        """Return what the device can do as the profile describes it."""
        table, output = self._table, self._table.output
        dog = None if output is None else output.watchdog
        info = (
            None if dog is None else daq.WatchdogInfo(dog.min_s, dog.max_s, dog.fed_by, dog.drops)
        )
        return daq.Capabilities(
            inputs=tuple(input_info(table, channel) for channel in table.channels),
            max_rates_hz=max_rates_hz(table),
            min_rate_hz=_MIN_RATE_HZ,
            reference=output is not None,
            enable=output is not None and output.enable is not None,
            watchdog=info,
        )

    def configure(self, settings: daq.DaqSettings) -> float:
        """Make the outputs safe, write settings that differ, and return the sample period, s."""
        self.identity()
        self._drop_acquisition()
        self._tripped = False
        self._make_safe()
        set_up(self._access, self._table)
        if settings.roles:
            inputs = Inputs(self._access, self._table, settings.roles)
            self._acquisition = Polling(inputs, settings)
        return settings.sample_period_s

    def start(self) -> None:
        """Begin to poll; a device without channels has nothing to start."""
        self._configured().begin()

    def read_block(self) -> daq.ScanBlock | None:
        """Return the next reading; None when none is due yet, or the device had none."""
        polling = self._running()
        guarded = self.outputs is not None and self.outputs.watchdog is not None
        if guarded and not time.monotonic() - self._looked_s < _LOOK_S:
            self._looked_s = time.monotonic()
            self._tripped = self.watchdog().tripped
        return polling.next_block(tripped=self._tripped)

    def stop(self) -> None:
        """Poll no more."""
        if self._acquisition is not None:
            self._acquisition.stopped = True

    def snapshot(self) -> Mapping[daq.Role, float]:
        """Return one reading of every channel; empty where there is none, or it is invalid."""
        roles = self._table.roles
        if not roles:
            return {}
        reading = Inputs(self._access, self._table, roles).read()
        return {} if reading.doubt else dict(zip(roles, reading.values, strict=True))

    def _who(self) -> Identity:
        return check_identity(self._access, self._table)


# data of a reply stand behind function code and byte count
_DATA_AT = 2
# what still counts as zero where the output is a float, V
_ZERO_V = 1e-3


def open_modbus(profile: ProfileData, table: ModbusAcquisition) -> ModbusDaq:
    """Open the device; nothing is connected or written yet."""
    # pymodbus is loaded by those who open such a device alone
    from hdbench.devices.modbus.replies import polled_link

    address = address_of(table, default_port=502)
    if not address.is_numbered:
        _check_deadline(table, reopened=not address.is_line)
    probe = make_probe(table)
    link = polled_link(address, unit=table.unit, probe=probe, tls=table.tls)
    access = Access(
        link,
        table,
        probe=None if address.is_numbered else probe,
        numbered=address.is_numbered,
    )
    return ModbusDaq(access, table)


def _check_deadline(table: ModbusAcquisition, *, reopened: bool) -> None:
    """Refuse a deadline whose tries are too short: a quiet line, a probe, a read, a probe.

    What is opened anew after a fault is also asked who it is.
    """
    longest = max((block.reply_bytes for block in reads_of(table)), default=2)
    looks = table.identify if reopened else ()
    known_s = sum(exchange_s(table, 2 * layout.place_of(table, rule).size) for rule in looks)
    needed_s = (QUIET_S + known_s + 3.0 * exchange_s(table, longest)) / TRY
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
    place = layout.place_of(table, output)
    back = place if output.read_back is None else layout.place_of(table, output.read_back)
    zero, scale = -output.offset / output.scale, abs(output.scale)
    spread = (output_step_v(output) or _ZERO_V) / scale
    finals, final_looks = [], []
    if output.enable is not None:
        line, off = layout.place_of(table, output.enable), float(output.enable.off)
        finals.append(layout.write_request(line, off))
        final_looks.append(_look(line, "enable line", off, off))
    return Target(
        target_at(
            address_of(table, default_port=502), table.unit, table.tls, rest_s=table.min_gap_s
        ),
        acts=(layout.write_request(place, zero, output.function),),
        looks=(_look(back, "motor reference, steps", zero - spread, zero + spread),),
        identity=tuple(
            _look(
                where := layout.place_of(table, rule),
                where.name,
                *layout.bounds(rule),
                rule.mask or 0,
            )
            for rule in table.identify
        ),
        finals=tuple(finals),
        final_looks=tuple(final_looks),
        brake_s=output.brake_s,
    )


def _look(place: Register, name: str, low: float, high: float, mask: int = 0) -> Look:
    """Return a read of one value that must lie between two others."""
    (block,) = layout.plan_blocks([place], most=place.size, bridge=0)
    form, order, mask = (">B", (), 1) if place.is_bit else (*layout.form_of(place), mask)
    return Look(block.request(), (Check(name, _DATA_AT, form, low, high, mask, order),))


DRIVER = Driver(
    open=open_modbus,
    rate_hz=lambda table: (math.inf, *max_rates_hz(table))[-1],
    drives=lambda table: table.output is not None,
    stop_target=stop_target,
    emulate=later("hdbench.devices.emulator.modbus:emulate_modbus"),
)
