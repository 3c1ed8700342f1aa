"""The node's parameter block: what it accepts, and the wave it means."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.devices.emulator.server import ModbusRefusedError
from hdbench.devices.node.codec import Value
from hdbench.devices.node.registers import (
    ALL_CHANNELS,
    PARAMETERS,
    PROGRAM_WAVE,
    WAVES,
    Refusal,
    register,
)
from hdbench.profile.schema import ReferenceWave

__all__ = ["DEFAULT_PARAMETERS", "RefusedError", "check_parameters", "reference_wave"]

# values come as 32-bit floats, rounded by at most 6e-8 of their size
_ROUNDING = 1e-6

DEFAULT_PARAMETERS: Mapping[str, Value] = {
    entry.name: 1_000_000 if entry.name == "sample_period_ns" else 0 for entry in PARAMETERS
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
    if not peak_v <= float(limits["limit_reference_v"]) * (1.0 + _ROUNDING):
        raise _refused("amplitude_v", Refusal.REFERENCE_LIMIT)
    peak_rad_s = peak_v * float(limits["velocity_per_volt"])
    if not peak_rad_s <= float(limits["limit_velocity_rad_s"]) * (1.0 + _ROUNDING):
        raise _refused("amplitude_v", Refusal.VELOCITY_LIMIT)
    if not 0 <= int(values["wave"]) < len(WAVES):
        raise _refused("wave", Refusal.WAVE)
    if values["wave"] == PROGRAM_WAVE:
        return
    try:
        reference_wave(values)
    except ValueError as error:
        raise _refused("wave", Refusal.WAVE) from error


def _refused(name: str, reason: Refusal) -> RefusedError:
    return RefusedError(3, reason, register(name).address)
