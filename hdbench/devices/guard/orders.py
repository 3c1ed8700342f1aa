"""Orders for the guard, driver by driver."""

from __future__ import annotations

from collections.abc import Callable

from hdbench.children import child_command
from hdbench.devices.guard.order import Check, GuardOrder, Look, Target, target_at
from hdbench.devices.wire import read_registers, write_register
from hdbench.profile.acquiring import Acquisition, CompositeAcquisition, NodeAcquisition
from hdbench.profile.acquiring_labjack import LabJackAcquisition, LabJackOutput
from hdbench.profile.schema import ProfileData

__all__ = ["order_of"]

# standing still: eight standard deviations of a tacho with 1 mV noise at 56 rad/s per volt
_STANDSTILL_RAD_S = 0.5
# an output of 0 V as the device reads it back: below the step of any converter
_ZERO_V = 0.02


def order_of(profile: ProfileData) -> GuardOrder:
    """Return what the guard of a bench is to do.

    Parameters
    ----------
    profile : ProfileData
        The bench, its addresses as they are in use.

    Returns
    -------
    GuardOrder
        The bytes themselves for drivers that are known here; else a command that stops the bench
        through its driver, which takes as long as the libraries need to load.
    """
    table = profile.daq
    driving = table.outputs if isinstance(table, CompositeAcquisition) else table
    build = _BUILDERS.get(driving.driver)
    target = build(profile, driving) if build is not None else None
    if target is None:
        command = child_command("hdbench.devices.guard.whole")
        return GuardOrder(command=command, stdin=profile.model_dump_json(exclude_none=True))
    return GuardOrder(targets=(target,))


def _node(profile: ProfileData, table: Acquisition) -> Target | None:
    """Return: command "safe", which anybody may give, and the status block."""
    from hdbench.devices.node.opening import node_address
    from hdbench.devices.node.registers import IDENTITY, STATUS, Command, Flag, register

    if not isinstance(table, NodeAcquisition):
        return None
    first = STATUS[0].address

    def at(name: str) -> int:
        return 2 + 2 * (register(name).address - first)

    count = sum(entry.size for entry in STATUS)
    active = Flag.RUNNING | Flag.DRIVE_ENABLED
    checks = (
        Check("motor reference, V", at("reference_v"), ">f", 0.0, 0.0),
        Check(
            "motor speed, rad/s", at("velocity_rad_s"), ">f", -_STANDSTILL_RAD_S, _STANDSTILL_RAD_S
        ),
        Check("running or enabled, flags", at("status_flags"), ">H", 0, 0, mask=int(active)),
    )
    return Target(
        target_at(node_address(table), table.unit, table.tls),
        acts=(write_register(register("command").address, Command.SAFE),),
        looks=(Look(read_registers(first, count), checks),),
        identity=read_registers(IDENTITY[0].address, sum(entry.size for entry in IDENTITY)),
    )


def _labjack(profile: ProfileData, table: Acquisition) -> Target | None:
    """Return: reference 0 V, stream off, tacho read; then the enable line off, its level read."""
    from hdbench.devices.labjack.feedback import feedback_request
    from hdbench.devices.labjack.registers import (
        IDENTITY,
        STREAM_ENABLE,
        Register,
        analog_input,
        dac,
        digital_line,
        tick_dac,
    )
    from hdbench.devices.labjack.scanlist import input_number
    from hdbench.devices.wire import parse_address

    if not (isinstance(table, LabJackAcquisition) and isinstance(table.output, LabJackOutput)):
        return None
    output = table.output

    def look(register: Register, check: Check) -> Look:
        return Look(feedback_request((), (register,)), (check,))

    tick = output.output.startswith("TDAC")
    number = int(output.output.lstrip("TDAC"))
    reference = tick_dac(number) if tick else dac(number)
    # what is not measured or cannot be read back is not looked at: the enable line still is
    looks = [] if tick else [look(reference, Check("reference, V", 1, ">f", -_ZERO_V, _ZERO_V))]
    for channel in table.channels:
        if channel.role == "tacho":
            limit_v = _STANDSTILL_RAD_S / abs(profile.tacho.gain_rad_s_per_v * channel.scale)
            name = f"tacho ({_STANDSTILL_RAD_S:g} rad/s are {limit_v:.3g} V), V"
            check = Check(name, 1, ">f", -limit_v, limit_v)
            looks.append(look(analog_input(input_number(channel)), check))
    line = digital_line(output.enable_line)
    off = 0 if output.enable_high else 1
    stop = feedback_request(((STREAM_ENABLE, 0),), ())
    return Target(
        target_at(parse_address(table.address, default_port=502), 1),
        acts=(feedback_request(((reference, 0.0),), ()), stop),
        looks=tuple(looks),
        identity=feedback_request((), IDENTITY),
        finals=(feedback_request(((line, off),), ()),),
        final_looks=(look(line, Check("enable line", 1, ">H", off, off)),),
    )


def _modbus(_profile: ProfileData, table: Acquisition) -> Target | None:
    from hdbench.devices.guard.polled import polled_target

    return polled_target(table)


_BUILDERS: dict[str, Callable[[ProfileData, Acquisition], Target | None]] = {
    "node": _node,
    "labjack-t": _labjack,
    "modbus": _modbus,
}
