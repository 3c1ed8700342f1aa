"""Opening of a polled device: its link, its rate, its stop target."""

from __future__ import annotations

import math

from hdbench.devices.driver import Driver, later
from hdbench.devices.guard.order import Check, Look, Target, target_at
from hdbench.devices.modbus.access import QUIET_S, TRY, Access
from hdbench.devices.modbus.driver import ModbusDaq, exchange_s, max_rates_hz, reads_of
from hdbench.devices.modbus.identity import make_probe
from hdbench.devices.modbus.layout import (
    bounds,
    form_of,
    place_of,
    plan_blocks,
    write_request,
)
from hdbench.devices.modbus.outputs import output_step_v
from hdbench.devices.registers import Register
from hdbench.devices.wire import parse_address
from hdbench.devices.wire.address import serial_settings
from hdbench.errors import ProfileError
from hdbench.profile.acquiring_modbus import ModbusAcquisition
from hdbench.profile.schema import ProfileData

# data of a reply stand behind function code and byte count
_DATA_AT = 2
# what still counts as zero where the output is a float, V
_ZERO_V = 1e-3


def open_modbus(profile: ProfileData, table: ModbusAcquisition) -> ModbusDaq:
    """Open the device; nothing is connected or written yet."""
    # pymodbus is loaded by those who open such a device alone
    from hdbench.devices.modbus.links import polled_link

    given = None if table.serial is None else serial_settings(table.serial)
    address = parse_address(table.address, given, default_port=502)
    if not address.is_numbered:
        _check_deadline(table)
    probe = make_probe(table)
    link = polled_link(address, unit=table.unit, probe=probe, tls=table.tls)
    access = Access(
        link,
        deadline_s=table.deadline_s,
        probe=None if address.is_numbered else probe,
        numbered=address.is_numbered,
        min_gap_s=table.min_gap_s,
        max_registers=table.max_read_registers,
        bridge=table.bridge_registers,
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
