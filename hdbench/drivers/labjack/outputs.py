"""Motor reference, enable line, the watchdog that drops it, and how the guard stops the motor."""

from __future__ import annotations

import math

from hdbench.devices.base import HostOutputs
from hdbench.devices.daq import WatchdogState
from hdbench.devices.guard.order import Check, Look, Target, target_at
from hdbench.devices.registers import Register, as_float32
from hdbench.devices.safestate import STANDSTILL_RAD_S
from hdbench.devices.wire.address import address_of
from hdbench.drivers.labjack import registers as reg
from hdbench.drivers.labjack.control import Control, feedback_request
from hdbench.drivers.labjack.table import LabJackAcquisition, LabJackOutput
from hdbench.profile.schema import ProfileData

_TICK_DAC_V = 10.0
_DAC_V = 5.0
_BITS = {"T7": 12, "T4": 10}
_TICK_DAC_BITS = 14
# the looped-back reference, and an output of 0 V as the device reads it back: offset and noise of
# the converter, far below what turns a motor
_ZERO_V = 0.02


def output_range_v(output: LabJackOutput) -> tuple[float, float]:
    """Return the range that may be written: that of the converter within the profile's limit."""
    low, high = (-_TICK_DAC_V, _TICK_DAC_V) if _is_tick_dac(output) else (0.0, _DAC_V)
    return max(low, -output.limit_v), min(high, output.limit_v)


def output_step_v(output: LabJackOutput, model: str) -> float:
    """Return the smallest change that the converter shows."""
    if _is_tick_dac(output):
        return 2.0 * _TICK_DAC_V / (1 << _TICK_DAC_BITS)
    return _DAC_V / (1 << _BITS[model])


class Outputs(HostOutputs):
    """Writes them, and remembers what was ordered."""

    def __init__(self, control: Control, output: LabJackOutput, model: str) -> None:
        super().__init__(control.where, output.output, output_range_v(output), zero_v=_ZERO_V)
        self.tripped = False
        self.ordered_on = False
        self.watchdog = Watchdog(control, output, self)
        self._control = control
        self._output = output
        self._model = model

    def _put(self, value: float) -> float:
        """Write the motor reference and return what is read back, V.

        A DAC reads back. A LJTick-DAC cannot be read: what it acknowledged is returned, and what
        stands at its terminal shows in the looped-back reference channel.
        """
        output, register = self._output, _register(self._output)
        wanted = as_float32(value)
        if _is_tick_dac(output):
            self._control.feedback(((register, value),))
            return wanted
        (found,) = self._control.feedback(((register, value),), (register,))
        if not abs(found - wanted) <= output_step_v(output, self._model):
            raise self._control.error_at(
                register,
                f"{register.name} reads back as {found:.6g} V; written: {value:.6g} V",
                "use the emergency stop if the motor turns, then check the output",
            )
        return float(found)

    def read_back(self) -> float | None:
        """Return the reference that the output register holds, V; None where it cannot be read."""
        if _is_tick_dac(self._output):
            return None
        return float(self._control.read(_register(self._output))[0])

    def enable(self, *, on: bool) -> bool:
        """Write the enable line and return the level at its terminal, as on or off."""
        self.ordered_on = on
        if on:
            self.tripped = False
        register = reg.digital_line(self._output.enable_line)
        level = int(on == self._output.enable_high)
        (found,) = self._control.feedback(((register, level),), (register,))
        return bool(found) == self._output.enable_high

    def make_safe(self) -> None:
        """Write reference 0, then switch the line off; a trip is forgotten."""
        super().make_safe()
        self.tripped = False

    def note_levels(self, levels: int) -> None:
        """Note a trip from the levels of all lines."""
        level = bool(levels >> self._output.enable_line & 1)
        self.note_enabled(on=level == self._output.enable_high)

    def note_enabled(self, *, on: bool) -> None:
        """Note a trip from the level of the enable line."""
        if self.ordered_on and not on:
            self.tripped = True


def _is_tick_dac(output: LabJackOutput) -> bool:
    return output.output.startswith("TDAC")


def _register(output: LabJackOutput) -> Register:
    number = int(output.output.lstrip("TDAC"))
    return reg.tick_dac(number) if _is_tick_dac(output) else reg.dac(number)


# what feeds it; any number would do, a streaming reader never writes it by chance
KEY = 0x68640B0E
_ALL_LINES = (1 << 23) - 1
_ENABLE = reg.WATCHDOG[0]


def watchdog_settings(output: LabJackOutput, time_s: float) -> dict[str, float]:
    """Return the watchdog's registers by name."""
    bit = 1 << output.enable_line
    values: dict[str, float] = {
        "ENABLE": 1,
        "ADVANCED": 0,
        "TIMEOUT_S": math.ceil(time_s),
        "STARTUP_DELAY_S": math.ceil(time_s),
        "STRICT_ENABLE": 1,
        "STRICT_KEY": KEY,
        "RESET_ENABLE": 0,
        "DIO_ENABLE": 1,
        "DIO_STATE": 0 if output.enable_high else bit,
        "DIO_DIRECTION": bit,
        "DIO_INHIBIT": _ALL_LINES & ~bit,
        "DAC0_ENABLE": int(output.output == "DAC0"),
        "DAC0": 0.0,
        "DAC1_ENABLE": int(output.output == "DAC1"),
        "DAC1": 0.0,
    }
    return {f"WATCHDOG_{name}_DEFAULT": value for name, value in values.items()}


class Watchdog:
    """The watchdog of one device."""

    def __init__(self, control: Control, output: LabJackOutput, outputs: Outputs) -> None:
        self._control = control
        self._output = output
        self._outputs = outputs

    def read(self) -> dict[str, float]:
        """Return its settings by register name."""
        values = self._control.read(*reg.WATCHDOG)
        return {register.name: value for register, value in zip(reg.WATCHDOG, values, strict=True)}

    def arm(self, time_s: float) -> float:
        """Bring it to the wanted settings, writing flash only where they differ, and feed it."""
        wanted = watchdog_settings(self._output, time_s)
        found = self.read()
        if found != wanted:
            self._write(wanted, found)
            found = self.read()
        for register in reg.WATCHDOG:
            if found[register.name] != wanted[register.name]:
                raise self._control.error_at(
                    register,
                    f"{register.name} reads back as {found[register.name]:g}; written: "
                    f"{wanted[register.name]:g}",
                    "without this watchdog nothing may move: check the device's firmware",
                )
        self.feed()
        return float(found["WATCHDOG_TIMEOUT_S_DEFAULT"])

    def feed(self) -> None:
        """Write its key; the same transaction shows whether the enable line has dropped."""
        key = ((reg.STRICT_CLEAR, KEY),)
        (levels,) = self._control.feedback(key, (reg.DIO_STATE,), repeatable=True)
        self._outputs.note_levels(int(levels))

    def state(self) -> WatchdogState:
        """Return its state: settings from flash, a trip from the level of the enable line."""
        values = self.read()
        armed = bool(values["WATCHDOG_ENABLE_DEFAULT"] and values["WATCHDOG_STRICT_ENABLE_DEFAULT"])
        self._outputs.note_levels(int(self._control.read(reg.DIO_STATE)[0]))
        return WatchdogState(armed, self._outputs.tripped, values["WATCHDOG_TIMEOUT_S_DEFAULT"])

    def clear(self) -> None:
        """Do nothing: it stays on, as it is kept in flash."""

    def _write(self, wanted: dict[str, float], found: dict[str, float]) -> None:
        """Write what differs: it must be off meanwhile, and goes on last."""
        if found[_ENABLE.name]:
            self._put(_ENABLE, 0)
        for register in reg.WATCHDOG[1:]:
            if found[register.name] != wanted[register.name]:
                self._put(register, wanted[register.name])
        self._put(_ENABLE, wanted[_ENABLE.name])

    def _put(self, register: Register, value: float) -> None:
        self._control.write((register,), (value,))


def stop_target(profile: ProfileData, table: LabJackAcquisition) -> Target | None:
    """Return how a LabJack stops the motor."""
    output = table.output
    if output is None:
        return None

    def look(register: Register, check: Check) -> Look:
        return Look(feedback_request((), (register,)), (check,))

    reference = _register(output)
    # what is not measured or cannot be read back is not looked at: the enable line still is
    looks = (
        []
        if _is_tick_dac(output)
        else [look(reference, Check("reference, V", 1, ">f", -_ZERO_V, _ZERO_V))]
    )
    for channel in table.channels:
        if channel.role == "tacho":
            limit_v = STANDSTILL_RAD_S / abs(profile.tacho.gain_rad_s_per_v * channel.scale)
            name = f"tacho ({STANDSTILL_RAD_S:g} rad/s are {limit_v:.3g} V), V"
            check = Check(name, 1, ">f", -limit_v, limit_v)
            looks.append(look(reg.analog_input(channel.number), check))
    line = reg.digital_line(output.enable_line)
    off = 0 if output.enable_high else 1
    stop = feedback_request(((reg.STREAM_ENABLE, 0),), ())
    return Target(
        target_at(address_of(table, default_port=502), 1),
        acts=(feedback_request(((reference, 0.0),), ()), stop),
        looks=tuple(looks),
        identity=(Look(feedback_request((), reg.IDENTITY)),),
        finals=(feedback_request(((line, off),), ()),),
        final_looks=(look(line, Check("enable line", 1, ">H", off, off)),),
    )
