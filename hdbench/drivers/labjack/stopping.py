"""Requests by which the guard stops a LabJack's motor: reference, stream, enable line."""

from __future__ import annotations

from hdbench.devices.guard.order import Check, Look, Target, target_at
from hdbench.devices.safestate import STANDSTILL_RAD_S
from hdbench.devices.wire import parse_address
from hdbench.drivers.labjack.control import feedback_request
from hdbench.drivers.labjack.registers import (
    IDENTITY,
    STREAM_ENABLE,
    Register,
    analog_input,
    dac,
    digital_line,
    tick_dac,
)
from hdbench.drivers.labjack.scanlist import input_number
from hdbench.drivers.labjack.table import LabJackAcquisition
from hdbench.profile.schema import ProfileData

# an output of 0 V as the device reads it back: below the step of any converter
_ZERO_V = 0.02


def stop_target(profile: ProfileData, table: LabJackAcquisition) -> Target | None:
    """Return how a LabJack stops the motor."""
    output = table.output
    if output is None:
        return None

    def look(register: Register, check: Check) -> Look:
        return Look(feedback_request((), (register,)), (check,))

    tick = output.output.startswith("TDAC")
    number = int(output.output.lstrip("TDAC"))
    reference = tick_dac(number) if tick else dac(number)
    # what is not measured or cannot be read back is not looked at: the enable line still is
    looks = [] if tick else [look(reference, Check("reference, V", 1, ">f", -_ZERO_V, _ZERO_V))]
    for channel in table.channels:
        if channel.role == "tacho":
            limit_v = STANDSTILL_RAD_S / abs(profile.tacho.gain_rad_s_per_v * channel.scale)
            name = f"tacho ({STANDSTILL_RAD_S:g} rad/s are {limit_v:.3g} V), V"
            check = Check(name, 1, ">f", -limit_v, limit_v)
            looks.append(look(analog_input(input_number(channel)), check))
    line = digital_line(output.enable_line)
    off = 0 if output.enable_high else 1
    stop = feedback_request(((STREAM_ENABLE, 0),), ())
    return Target(
        target_at(parse_address(table.address, default_port=502), 1),
        acts=(feedback_request(((reference, 0.0),), ()), stop),
        looks=tuple(looks),
        identity=(Look(feedback_request((), IDENTITY)),),
        finals=(feedback_request(((line, off),), ()),),
        final_looks=(look(line, Check("enable line", 1, ">H", off, off)),),
    )
