"""Register map of a bench controller node (`docs/node-protocol.md`)."""

from __future__ import annotations

from enum import IntEnum, IntFlag
from itertools import chain

from hdbench.devices.daq import Role
from hdbench.devices.registers import BLOCK_DATA_REGISTERS, Register
from hdbench.system.files import packaged_toml


class State(IntEnum):
    """What the node is doing."""

    IDLE = 0
    RUNNING = 1
    FINISHED = 2
    STOPPED = 3
    TRIPPED = 4


class Command(IntEnum):
    """What can be written to `command`."""

    START = 1
    STOP = 2
    SAFE = 3


class Flag(IntFlag):
    """Bits of `block_flags` and `status_flags`."""

    OVERFLOW = 1
    RUNNING = 2
    WATCHDOG_TRIPPED = 4
    DRIVE_ENABLED = 8


class Capability(IntFlag):
    """Bits of `capabilities`."""

    SIMULATED = 1
    PROGRAM = 4


class Refusal(IntEnum):
    """Why the last refused request of this connection was refused."""

    NONE = 0
    ADDRESS = 1
    REFERENCE_LIMIT = 2
    VELOCITY_LIMIT = 3
    SAMPLE_PERIOD = 4
    SAMPLE_COUNT = 5
    WAVE = 6
    WATCHDOG_TIME = 7
    RUNNING = 8
    SESSION_HELD = 9
    TRIPPED = 10
    VALUE = 11


PROTOCOL_VERSION = 2
WORD_ORDER_TEST = 0x00112233
# words of a scan in the order of their bits in `channels`; one register each
CHANNELS: tuple[Role, ...] = ("torque", "tacho", "current", "reference", "encoder")
ENCODER_HIGH, ENCODER_LOW = 0x10, 0x20
ALL_CHANNELS = 0x3F
BLOCK_HEADER_REGISTERS = 12


def block_scans(width: int) -> int:
    """Return how many scans a full block holds."""
    return BLOCK_DATA_REGISTERS // width


def block_registers(width: int) -> int:
    """Return how many registers of the window a host reads."""
    return BLOCK_HEADER_REGISTERS + block_scans(width) * width


# register value of each wave type; 0 keeps the drive disabled
WAVES = ("none", "constant", "sine", "square", "triangle", "trapezoid", "chirp", "program")
PROGRAM_WAVE = WAVES.index("program")
# numbers of a wave and of a program's part, under the names that the model has for them
WAVE_NUMBERS = (
    "bias_v", "amplitude_v", "frequency_hz", "end_frequency_hz", "duty", "rise", "fall",
)  # fmt: skip
PART_NUMBERS = ("start_v", "end_v", "amplitude_v", "frequency_hz", "end_frequency_hz")


def _groups() -> dict[str, tuple[Register, ...]]:
    """Return the registers of ``registers.toml``, group by group."""
    groups = {}
    for name, table in packaged_toml(__package__, "registers.toml").items():
        entries, address = [], table["start"]
        for label, kind, meaning in table["registers"]:
            entries.append(Register(label, address, kind, table["writable"], meaning))
            address += entries[-1].size
        groups[name] = tuple(entries)
    return groups


_GROUPS = _groups()
BLOCK, IDENTITY, LIMITS, STATUS, FEED, NONCE, PARAMETERS, CONTROL, SESSION, PROGRAM = (
    _GROUPS.values()
)
MAP = tuple(chain.from_iterable(_GROUPS.values()))

_BY_NAME = {entry.name: entry for entry in MAP}
_BY_ADDRESS = {entry.address + k: entry for entry in MAP for k in range(entry.size)}


def register(name: str) -> Register:
    """Return the entry called `name`."""
    return _BY_NAME[name]


def register_at(address: int) -> Register | None:
    """Return the entry that covers `address`."""
    return _BY_ADDRESS.get(address)
