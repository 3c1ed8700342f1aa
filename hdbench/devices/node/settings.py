"""The parameter block that an acquisition asks for."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.devices.daq import DaqSettings
from hdbench.devices.node.blockvalues import channel_bits
from hdbench.devices.node.codec import Value, as_float32
from hdbench.devices.node.registers import PROGRAM_WAVE, WAVES, register
from hdbench.errors import DeviceError
from hdbench.model.program import ReferenceProgram
from hdbench.profile.schema import ReferenceWave

__all__ = ["parameter_values", "part_values"]


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
