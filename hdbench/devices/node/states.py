"""The numbers in the node's registers that have names."""

from __future__ import annotations

from enum import IntEnum, IntFlag

__all__ = ["Capability", "Command", "Flag", "Refusal", "State"]


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
