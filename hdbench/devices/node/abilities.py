"""What a node can do, and how fast its wire is."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from hdbench.devices.capabilities import ROLE_UNITS, Capabilities, InputInfo, Role, WatchdogInfo
from hdbench.devices.node.codec import Value
from hdbench.devices.node.registers import CHANNELS, block_registers, block_scans
from hdbench.devices.wire.address import Address

__all__ = ["REPLY_CHARACTERS", "REQUEST_CHARACTERS", "capabilities_of", "exchange_rate_hz"]

# characters around the registers of an FC23 exchange on a serial line: request with two registers
# written; unit, function, byte count and checksum of the reply
REQUEST_CHARACTERS = 17
REPLY_CHARACTERS = 5
# share of the wire's limit that is sustained (measured: docs/devices.md)
_SUSTAINED = 0.9
# a device on Ethernet answers within a millisecond or two; two on the safe side
_NETWORK_EXCHANGE_S = 0.002


def exchange_rate_hz(address: Address, n_channels: int) -> float:
    """Return the sustained rate of block exchanges, Hz."""
    if address.scheme != "rtu":
        return 1.0 / _NETWORK_EXCHANGE_S
    received = REPLY_CHARACTERS + 2 * block_registers(n_channels)
    return _SUSTAINED / address.serial.exchange_s(REQUEST_CHARACTERS, received)


def capabilities_of(
    limits: Mapping[str, Value], exchanges_hz: Callable[[int], float], *, simulated: bool
) -> Capabilities:
    """Return the capabilities of a node."""
    fastest_hz = 1e9 / float(limits["min_period_ns"])
    rates = tuple(
        min(fastest_hz, exchanges_hz(n) * block_scans(n)) for n in range(1, len(CHANNELS) + 1)
    )
    return Capabilities(
        inputs=tuple(_input(role, limits) for role in CHANNELS),
        max_rates_hz=rates,
        min_rate_hz=1e9 / float(limits["max_period_ns"]),
        outputs=(),
        generator=True,
        enable=True,
        buffered=True,
        buffer_scans=int(limits["fifo_scans"]),
        watchdog=WatchdogInfo(
            min_s=1e-3 * float(limits["watchdog_min_ms"]),
            max_s=1e-3 * float(limits["watchdog_max_ms"]),
            step_s=1e-3,
            fed_by="heartbeat",
            drops=("reference", "enable"),
            latches=True,
        ),
        simulated=simulated,
    )


def _input(role: Role, limits: Mapping[str, Value]) -> InputInfo:
    if role == "encoder":
        return InputInfo(role, -(2.0**31), 2.0**31 - 1.0, bits=32, wrap=2**32)
    key = "current_range_a" if ROLE_UNITS[role] == "A" else "range_v"
    bits = int(limits["converter_bits"])
    top = 1.0 - 2.0 ** (1 - bits)
    return InputInfo(role, -float(limits[key]), top * float(limits[key]), bits=bits)
