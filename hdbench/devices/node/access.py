"""Node access: identity, limits, and parameters that are read back."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

from hdbench.devices.bench import Identity
from hdbench.devices.daq import DaqSettings
from hdbench.devices.node.blocks import channel_bits
from hdbench.devices.node.registers import (
    IDENTITY,
    LIMITS,
    PROGRAM,
    PROGRAM_WAVE,
    PROTOCOL_VERSION,
    STATUS,
    WAVES,
    WORD_ORDER_TEST,
    Capability,
    Command,
    Register,
    Value,
    as_float32,
    decode_group,
    encode_group,
    register,
)
from hdbench.devices.node.wire import NodeWire
from hdbench.devices.wire import FrameError
from hdbench.errors import DeviceError
from hdbench.model.waves import ReferenceProgram
from hdbench.profile.schema import ReferenceWave

# codes fill 16 bits from the left
_FEWEST_BITS, _MOST_BITS = 8, 16
_ABOVE_ZERO = ("range_v", "current_range_a", "limit_velocity_rad_s")


def parameter_values(settings: DaqSettings, limits: Mapping[str, Value]) -> dict[str, Value]:
    """Return the values of the parameter block, by register name."""
    program = settings.reference if isinstance(settings.reference, ReferenceProgram) else None
    wave = settings.reference if isinstance(settings.reference, ReferenceWave) else None
    values: dict[str, Value] = {
        "bias_v": as_float32(wave.bias_v if wave else 0.0),
        "sample_period_ns": round(1e9 * settings.sample_period_s),
        "n_samples": settings.n_samples,
        "amplitude_v": as_float32(wave.amplitude_v if wave else 0.0),
        "wave": WAVES.index(wave.wave) if wave else PROGRAM_WAVE if program else 0,
        "frequency_hz": as_float32(wave.frequency_hz if wave else 0.0),
        "duty": as_float32(wave.duty if wave else 0.0),
        "rise": as_float32(wave.rise if wave else 0.0),
        "fall": as_float32(wave.fall if wave else 0.0),
        "end_frequency_hz": as_float32(wave.end_frequency_hz if wave else 0.0),
        "watchdog_ms": round(1e3 * settings.watchdog_s),
        "channels": channel_bits(settings.roles, settings.sample_period_s, limits),
    }
    _check(values, "sample_period_ns", limits["min_period_ns"], limits["max_period_ns"])
    _check(values, "n_samples", 1, limits["max_samples"])
    _check(values, "watchdog_ms", limits["watchdog_min_ms"], limits["watchdog_max_ms"])
    return values


def part_values(program: ReferenceProgram) -> list[dict[str, Value]]:
    """Return the values of the program block, one for each part, by register name."""
    return [
        {
            "program_part": number,
            "program_parts": len(program.parts),
            "part_samples": part.n_samples,
            "part_start_v": as_float32(part.start_v),
            "part_end_v": as_float32(part.end_v),
            "part_amplitude_v": as_float32(part.amplitude_v),
            "part_frequency_hz": as_float32(part.frequency_hz),
            "part_end_frequency_hz": as_float32(part.end_frequency_hz),
        }
        for number, part in enumerate(program.parts)
    ]


def _check(values: Mapping[str, Value], name: str, low: Value, high: Value) -> None:
    if not float(low) <= float(values[name]) <= float(high):
        raise DeviceError(
            f"{name} {values[name]} is outside the node's {low} to {high}",
            where=f"register {name} (0x{register(name).address:04X})",
            fix="change the plan, or [daq] of the profile",
        )


class NodeAccess(NodeWire):
    """Everything of a node but its acquisition.

    Parameters are those of `NodeWire`.
    """

    _identity: Identity | None = None
    _limits: dict[str, Value] | None = None
    _has_program = False

    def identity(self) -> Identity:
        """Return who answers; asked once, before anything is written."""
        if self._identity is None:
            values = decode_group(IDENTITY, self.read(IDENTITY))
            if values["word_order"] != WORD_ORDER_TEST:
                raise self.error(
                    f"word order test reads 0x{values['word_order']:08X}; "
                    f"needed: 0x{WORD_ORDER_TEST:08X}",
                    "word_order",
                    "this is no bench controller node, or its word order is swapped",
                )
            if values["protocol_version"] != PROTOCOL_VERSION:
                raise self.error(
                    f"map version {values['protocol_version']}; needed: {PROTOCOL_VERSION}",
                    "protocol_version",
                    "update the node's firmware or hdbench",
                )
            self._has_program = bool(int(values["capabilities"]) & Capability.PROGRAM)
            self._identity = Identity(
                vendor=str(values["vendor"]),
                model=str(values["model"]),
                serial=str(values["serial"]),
                firmware=str(values["firmware"]),
                simulated=bool(int(values["capabilities"]) & Capability.SIMULATED),
            )
        return self._identity

    def limits(self) -> dict[str, Value]:
        """Return the node's own limits and scales, by register name."""
        if self._limits is None:
            found = decode_group(LIMITS, self.read(LIMITS))
            self._check_limits(found)
            self._limits = found
        return self._limits

    def _check_limits(self, found: dict[str, Value]) -> None:
        """Refuse scales that no node can have: everything measured is made with them."""
        bits = int(found["converter_bits"])
        if not _FEWEST_BITS <= bits <= _MOST_BITS:
            raise self.error(
                f"a converter of {bits} bits; needed: {_FEWEST_BITS} to {_MOST_BITS}",
                "converter_bits",
                "correct the node's firmware (docs/node-protocol.md)",
            )
        for name in _ABOVE_ZERO:
            # written so that NaN fails
            if not 0.0 < float(found[name]) < math.inf:
                raise self.error(
                    f"{name} is {found[name]}; needed: a number above 0",
                    name,
                    "correct the node's firmware (docs/node-protocol.md)",
                )

    def status(self) -> dict[str, Value]:
        """Return the status block of this moment, by register name."""
        return decode_group(STATUS, self.read_status())

    def command(self, command: Command) -> None:
        """Write a command, once."""
        self.write_once((register("command"),), struct.pack(">H", command))

    def make_safe(self) -> None:
        """Order the safe state of a device that is known to be a node."""
        self.identity()
        self.command(Command.SAFE)

    def write_program(self, program: ReferenceProgram) -> None:
        """Write the parts of a program and read each of them back."""
        if not self._has_program:
            raise self.error(
                "this node's generator has no program; needed: bit 2 of the capabilities",
                "capabilities",
                "update the node's firmware (docs/node-protocol.md), or run without --plan",
            )
        for part in part_values(program):
            self.write_and_read_back(PROGRAM, part)

    def write_and_read_back(self, group: tuple[Register, ...], wanted: dict[str, Value]) -> None:
        """Write `wanted` once; what counts is what then stands in the node."""
        try:
            self.write_once(group, encode_group(group, wanted))
        except DeviceError as error:
            if not isinstance(error.__cause__, FrameError):
                raise
        found = decode_group(group, self.read(group))
        for name, value in wanted.items():
            if found[name] != value:
                raise self.error(
                    f"{name} reads back as {found[name]}; written: {value}",
                    name,
                    "run again; if it stays, check the node's firmware",
                )

    def error(self, what: str, name: str, fix: str) -> DeviceError:
        """Return an error that names a register."""
        entry = register(name)
        return DeviceError(
            what, where=f"{self.where}, register {name} (0x{entry.address:04X})", fix=fix
        )
