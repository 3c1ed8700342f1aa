"""Who answers, checked before any setting is sent."""

from __future__ import annotations

from hdbench.devices.bench import Identity
from hdbench.drivers.dataq.commands import Commands
from hdbench.drivers.dataq.models import MODELS
from hdbench.drivers.dataq.table import DataqAcquisition
from hdbench.errors import DeviceError

__all__ = ["EMULATOR_NAME", "check_identity"]

# the name that hdbench's own emulator has
EMULATOR_NAME = "hdbench-emulator"
_VENDOR, _MODEL, _FIRMWARE, _NAME, _SERIAL = 0, 1, 2, 5, 6
_DIGITS = 8


def check_identity(commands: Commands, table: DataqAcquisition) -> Identity:
    """Return who answers, if it is the instrument that the profile means.

    Notes
    -----
    The line has no checksum: every answer is asked for until two in a row agree.
    """
    vendor, model = _agreed(commands, _VENDOR), _agreed(commands, _MODEL)
    serial = _agreed(commands, _SERIAL)[:_DIGITS]
    wanted = MODELS[table.model].number
    if vendor != "DATAQ" or model.removeprefix("DI-").upper() != wanted:
        raise DeviceError(
            f"{vendor[:20]!r} {model[:20]!r} answers; needed: DATAQ {wanted}",
            where=commands.where,
            fix="correct daq.model or daq.address in the profile",
        )
    if table.serial_number is not None and serial.upper() != table.serial_number:
        raise DeviceError(
            f"serial number {serial!r} answers; needed: {table.serial_number}",
            where=commands.where,
            fix="correct daq.serial_number or daq.address in the profile",
        )
    return Identity(
        vendor="DATAQ",
        model=table.model,
        serial=serial,
        firmware=_version(_agreed(commands, _FIRMWARE)),
        simulated=_agreed(commands, _NAME) == EMULATOR_NAME,
    )


def _agreed(commands: Commands, item: int) -> str:
    """Return an item that two answers in a row agree about."""
    answers = [commands.ask(f"info {item}")]
    while len(answers) < 4:
        answers.append(commands.ask(f"info {item}"))
        if answers[-1] == answers[-2]:
            return answers[-1]
    raise DeviceError(
        f"'info {item}' is answered differently every time: {answers[-1][:20]!r}",
        where=commands.where,
        fix="exchange the cable",
    )


def _version(text: str) -> str:
    """Return hexadecimal 65 as 1.01."""
    try:
        return f"{int(text, 16) / 100.0:.2f}"
    except ValueError:
        return text
