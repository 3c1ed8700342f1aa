"""What the emulated node is rated for, taken from the profile of the bench it stands in."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.devices.node.codec import Value
from hdbench.devices.node.registers import (
    BLOCK_DATA_REGISTERS,
    PROTOCOL_VERSION,
    WORD_ORDER_TEST,
    Capability,
)
from hdbench.profile.schema import ProfileData

__all__ = ["FIFO_SCANS", "identity_values", "limit_values"]

# four seconds at 1 kHz: twice the longest watchdog time
FIFO_SCANS = 4096
_MAX_SAMPLES = 100_000_000


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
