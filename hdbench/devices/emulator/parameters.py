"""Parameters of the emulated node: ratings, the block that it accepts, its generator program."""

from __future__ import annotations

import math
from collections.abc import Mapping

from hdbench.devices.emulator.server import ModbusRefusedError
from hdbench.devices.node.registers import (
    ALL_CHANNELS,
    PARAMETERS,
    PROGRAM,
    PROGRAM_WAVE,
    PROTOCOL_VERSION,
    WAVES,
    WORD_ORDER_TEST,
    Capability,
    Refusal,
    register,
)
from hdbench.devices.registers import BLOCK_DATA_REGISTERS, Value
from hdbench.model.waves import MAX_PARTS, ProgramPart, ReferenceProgram
from hdbench.profile.schema import ProfileData, ReferenceWave

# four seconds at 1 kHz: twice the longest watchdog time
FIFO_SCANS = 4096
_MAX_SAMPLES = 100_000_000
# values come as 32-bit floats, rounded by at most 6e-8 of their size
_ROUNDING = 1e-6
DEFAULT_PARAMETERS: Mapping[str, Value] = {
    entry.name: 1_000_000 if entry.name == "sample_period_ns" else 0 for entry in PARAMETERS
}


def identity_values(seed: int) -> Mapping[str, Value]:
    """Return the identity block of the emulator."""
    from hdbench import __version__

    return {
        "word_order": WORD_ORDER_TEST,
        "protocol_version": PROTOCOL_VERSION,
        "capabilities": int(Capability.SIMULATED | Capability.PROGRAM),
        "vendor": "hdbench",
        "model": "emulated node",
        "serial": f"sim-{seed % 1_000_000_000}",
        "firmware": __version__,
    }


def limit_values(profile: ProfileData) -> Mapping[str, Value]:
    """Return the limits block: the profile's limits and scales."""
    return {
        "limit_reference_v": profile.limits.reference_v,
        "limit_velocity_rad_s": profile.limits.velocity_rad_s,
        "velocity_per_volt": profile.servo.velocity_gain_rad_s_per_v,
        "min_period_ns": 100_000,
        "max_period_ns": 1_000_000_000,
        "max_samples": _MAX_SAMPLES,
        "watchdog_min_ms": 20,
        "watchdog_max_ms": 2000,
        "fifo_scans": FIFO_SCANS,
        "block_capacity": BLOCK_DATA_REGISTERS,
        "range_v": profile.daq.range_v,
        "current_range_a": profile.servo.max_current_a,
        "converter_bits": profile.daq.resolution_bits,
        "encoder_counts_per_turn": profile.encoder.counts_per_turn,
    }


class RefusedError(ModbusRefusedError):
    """A request that the node answers with an exception.

    Parameters
    ----------
    exception : int
        Modbus exception code.
    reason : Refusal
        The node's own reason.
    address : int
        First register concerned.
    """

    def __init__(self, exception: int, reason: Refusal, address: int) -> None:
        super().__init__(exception)
        self.reason = reason
        self.address = address


def reference_wave(values: Mapping[str, Value]) -> ReferenceWave | None:
    """Return the wave that a checked parameter block means."""
    code = int(values["wave"])
    if code in (0, PROGRAM_WAVE):
        return None
    duty, rise, fall = (float(values[name]) for name in ("duty", "rise", "fall"))
    if WAVES[code] == "trapezoid" and 0.0 < rise + duty + fall - 1.0 <= _ROUNDING:
        duty = 1.0 - rise - fall
    return ReferenceWave.model_validate(
        {
            "wave": WAVES[code],
            "bias_v": float(values["bias_v"]),
            "amplitude_v": float(values["amplitude_v"]),
            "frequency_hz": float(values["frequency_hz"]),
            "end_frequency_hz": float(values["end_frequency_hz"]),
            "duty": duty,
            "rise": rise,
            "fall": fall,
        }
    )


def check_parameters(values: Mapping[str, Value], limits: Mapping[str, Value]) -> None:
    """Refuse a parameter block that is outside the node's limits."""
    for name, low, high, reason in (
        ("sample_period_ns", "min_period_ns", "max_period_ns", Refusal.SAMPLE_PERIOD),
        ("watchdog_ms", "watchdog_min_ms", "watchdog_max_ms", Refusal.WATCHDOG_TIME),
    ):
        if not float(limits[low]) <= float(values[name]) <= float(limits[high]):
            raise _refused(name, reason)
    if not 1 <= int(values["n_samples"]) <= int(limits["max_samples"]):
        raise _refused("n_samples", Refusal.SAMPLE_COUNT)
    if not 0 <= int(values["channels"]) <= ALL_CHANNELS:
        raise _refused("channels", Refusal.VALUE)
    peak_v = abs(float(values["bias_v"])) + abs(float(values["amplitude_v"]))
    _check_peak(peak_v, limits, "amplitude_v")
    if not 0 <= int(values["wave"]) < len(WAVES):
        raise _refused("wave", Refusal.WAVE)
    if values["wave"] == PROGRAM_WAVE:
        return
    try:
        reference_wave(values)
    except ValueError as error:
        raise _refused("wave", Refusal.WAVE) from error


def _check_peak(peak_v: float, limits: Mapping[str, Value], name: str) -> None:
    """Refuse a reference, V, beyond the node's limits of volts or of speed."""
    if not peak_v <= float(limits["limit_reference_v"]) * (1.0 + _ROUNDING):
        raise _refused(name, Refusal.REFERENCE_LIMIT)
    peak_rad_s = peak_v * float(limits["velocity_per_volt"])
    if not peak_rad_s <= float(limits["limit_velocity_rad_s"]) * (1.0 + _ROUNDING):
        raise _refused(name, Refusal.VELOCITY_LIMIT)


def _refused(name: str, reason: Refusal) -> RefusedError:
    return RefusedError(3, reason, register(name).address)


class ProgramStore:
    """Parts that a host has written.

    Parameters
    ----------
    limits : mapping
        The limits block, by register name.
    """

    def __init__(self, limits: Mapping[str, Value]) -> None:
        self._limits = limits
        self._parts: list[ProgramPart] = []
        self._needed = 0
        self.last: dict[str, Value] = {entry.name: 0 for entry in PROGRAM}

    def forget(self) -> None:
        """Forget the program."""
        self._parts, self._needed = [], 0
        self.last = {entry.name: 0 for entry in PROGRAM}

    def take(self, values: Mapping[str, Value], address: int) -> None:
        """Keep one part: part 0 begins a program, any other follows the one before it."""
        if len(values) != len(PROGRAM):
            raise RefusedError(3, Refusal.VALUE, address)
        number, needed = int(values["program_part"]), int(values["program_parts"])
        kept = self._parts[:number]
        # a part may be written again, as it is when the answer to a write was lost
        follows = number == len(kept) and (number == 0 or needed == self._needed)
        if not (1 <= needed <= MAX_PARTS and number < needed and follows):
            raise _refused("program_part", Refusal.VALUE)
        part = self._checked(values)
        self._parts, self._needed = [*kept, part], needed
        self.last = dict(values)

    def check(self, parameters: Mapping[str, Value]) -> ReferenceProgram | None:
        """Return the program that a parameter block asks for; None where it asks for none."""
        if parameters["wave"] != PROGRAM_WAVE:
            return None
        if not self._parts or len(self._parts) != self._needed:
            raise _refused("wave", Refusal.WAVE)
        program = ReferenceProgram(tuple(self._parts))
        if program.n_samples != int(parameters["n_samples"]):
            raise _refused("n_samples", Refusal.SAMPLE_COUNT)
        return program

    def _checked(self, values: Mapping[str, Value]) -> ProgramPart:
        """Return one part within the limits; a NaN is outside."""
        part = ProgramPart(
            int(values["part_samples"]),
            float(values["part_start_v"]),
            float(values["part_end_v"]),
            float(values["part_amplitude_v"]),
            float(values["part_frequency_hz"]),
            float(values["part_end_frequency_hz"]),
        )
        if not 1 <= part.n_samples <= int(self._limits["max_samples"]):
            raise _refused("part_samples", Refusal.SAMPLE_COUNT)
        _check_peak(part.peak_v, self._limits, "part_start_v")
        frequencies = (part.frequency_hz, part.end_frequency_hz)
        if not all(0.0 <= f < math.inf for f in frequencies):
            raise _refused("part_frequency_hz", Refusal.VALUE)
        return part
