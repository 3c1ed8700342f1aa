"""Registers that the driver uses, and the device's own error codes.

Names, addresses, types and access are those of ``ljm_constants.json`` (LabJack Corporation, version
2025.12.18.A). All values are big-endian with the most significant word first.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import resources
from typing import cast

from hdbench.devices.registers import Kind, Register


def _table(name: str) -> list[list[str]]:
    """Return the lines of a text file beside this module, word by word."""
    text = (resources.files(__package__) / name).read_text(encoding="ascii")
    return [line.split() for line in text.splitlines()]


# name, address, type and access, as far as this driver makes use of it
BY_NAME = {
    name: Register(name, int(address), cast("Kind", kind), "W" in access)
    for name, address, kind, access in _table("registers.txt")
}


def _named(*names: str) -> tuple[Register, ...]:
    return tuple(BY_NAME[name] for name in names)


TEST, CORE, DIO_STATE = _named("TEST", "CORE_TIMER", "DIO_STATE")
IDENTITY = _named("PRODUCT_ID", "HARDWARE_VERSION", "FIRMWARE_VERSION", "SERIAL_NUMBER")
LAST_ERROR = _named("LAST_ERR_DETAIL", "LAST_ERR_FRAME", "LAST_ERR_TRANSACTION_ID")
STREAM_SETUP = tuple(entry for entry in BY_NAME.values() if 4002 <= entry.address <= 4012)
STREAM_TARGET = _named("STREAM_AUTO_TARGET", "STREAM_DATATYPE", "STREAM_NUM_SCANS")
STREAM_AUTORECOVER_DISABLE, STREAM_ENABLE = _named("STREAM_AUTORECOVER_DISABLE", "STREAM_ENABLE")
WATCHDOG = tuple(
    entry
    for name, entry in BY_NAME.items()
    if name.startswith("WATCHDOG_") and name.endswith("_DEFAULT")
)
STRICT_CLEAR, FLASH_POINTER = _named("WATCHDOG_STRICT_CLEAR", "INTERNAL_FLASH_READ_POINTER")
# memory that the device leaves to its host: which host holds the bench, and its sign of life
SESSION = _named("USER_RAM0_U32", "USER_RAM1_U32")
DEVICE_NAME = 60500
DEVICE_NAME_REGISTERS = 25
STREAM_CAPTURE_16 = 4899
FIO_EIO_STATE = 2580
FLASH_READ = 61812
BUFFER_SIZE = 32768


def _numbered(
    name: str, address: int, kind: Kind = "u32", *, step: int = 2, writable: bool = True
) -> Callable[[int], Register]:
    """Return what gives the register of one number; ``#`` in the name stands for it."""
    return lambda number: Register(
        name.replace("#", str(number)), address + step * number, kind, writable
    )


analog_input = _numbered("AIN#", 0, "f32", writable=False)
analog_range = _numbered("AIN#_RANGE", 40000, "f32")
negative_channel = _numbered("AIN#_NEGATIVE_CH", 41000, "u16", step=1)
dac = _numbered("DAC#", 1000, "f32")
tick_dac = _numbered("TDAC#", 30000, "f32")
digital_line = _numbered("DIO#", 2000, "u16", step=1)
ef_enable = _numbered("DIO#_EF_ENABLE", 44000)
ef_index = _numbered("DIO#_EF_INDEX", 44100)
ef_count = _numbered("DIO#_EF_READ_A", 3000, "i32", writable=False)
scan_list = _numbered("STREAM_SCANLIST_ADDRESS#", 4100)


def flash_words(count: int) -> tuple[Register, ...]:
    """Return floats of the flash."""
    return tuple(Register("INTERNAL_FLASH_READ", FLASH_READ + 2 * n, "f32") for n in range(count))


def user_name() -> tuple[Register, ...]:
    """Return the registers of DEVICE_NAME_DEFAULT, two characters each."""
    return tuple(
        Register("DEVICE_NAME_DEFAULT", DEVICE_NAME + n, "u16")
        for n in range(DEVICE_NAME_REGISTERS)
    )


@cache
def _error_names() -> dict[str, str]:
    """Return the names of ``ljm_constants.json`` by their numbers."""
    return dict(_table("error_names.txt"))


def error_name(code: int) -> str:
    """Return name and number of an error code."""
    name = _error_names().get(str(code))
    return f"{name} ({code})" if name else f"error {code}"
