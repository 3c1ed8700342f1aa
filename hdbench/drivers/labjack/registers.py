"""Registers that the driver uses, and the device's own error codes.

Names, addresses, types and access are those of ``ljm_constants.json`` (LabJack Corporation, version
2025.12.18.A). All values are big-endian with the most significant word first.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import resources

from hdbench.devices.registers import Kind, Register


def _rw(name: str, address: int, kind: Kind = "u32") -> Register:
    return Register(name, address, kind, True)


TEST = Register("TEST", 55100, "u32")
IDENTITY = (
    Register("PRODUCT_ID", 60000, "f32"),
    Register("HARDWARE_VERSION", 60002, "f32"),
    Register("FIRMWARE_VERSION", 60004, "f32"),
    Register("SERIAL_NUMBER", 60028, "u32"),
)
DEVICE_NAME = 60500
DEVICE_NAME_REGISTERS = 25
LAST_ERROR = (
    Register("LAST_ERR_DETAIL", 55000, "u16"),
    Register("LAST_ERR_FRAME", 55002, "u16"),
    Register("LAST_ERR_TRANSACTION_ID", 55003, "u16"),
)
CORE = Register("CORE_TIMER", 61520, "u32")

STREAM_SETUP = (
    _rw("STREAM_SCANRATE_HZ", 4002, "f32"),
    _rw("STREAM_NUM_ADDRESSES", 4004),
    _rw("STREAM_SAMPLES_PER_PACKET", 4006),
    _rw("STREAM_SETTLING_US", 4008, "f32"),
    _rw("STREAM_RESOLUTION_INDEX", 4010),
    _rw("STREAM_BUFFER_SIZE_BYTES", 4012),
)
AUTO_TARGET = _rw("STREAM_AUTO_TARGET", 4016)
STREAM_DATATYPE = _rw("STREAM_DATATYPE", 4018)
STREAM_TARGET = (AUTO_TARGET, STREAM_DATATYPE, _rw("STREAM_NUM_SCANS", 4020))
STREAM_AUTORECOVER_DISABLE = _rw("STREAM_AUTORECOVER_DISABLE", 4028)
STREAM_ENABLE = _rw("STREAM_ENABLE", 4990)
STREAM_CAPTURE_16 = 4899
FIO_EIO_STATE = 2580
DIO_STATE = Register("DIO_STATE", 2800, "u32")
FLASH_POINTER = _rw("INTERNAL_FLASH_READ_POINTER", 61810)
FLASH_READ = 61812
BUFFER_SIZE = 32768

_SETTINGS: tuple[tuple[str, int, Kind], ...] = (
    ("ENABLE", 61600, "u32"),
    ("ADVANCED", 61602, "u32"),
    ("TIMEOUT_S", 61604, "u32"),
    ("STARTUP_DELAY_S", 61606, "u32"),
    ("STRICT_ENABLE", 61610, "u32"),
    ("STRICT_KEY", 61612, "u32"),
    ("RESET_ENABLE", 61620, "u32"),
    ("DIO_ENABLE", 61630, "u32"),
    ("DIO_STATE", 61632, "u32"),
    ("DIO_DIRECTION", 61634, "u32"),
    ("DIO_INHIBIT", 61636, "u32"),
    ("DAC0_ENABLE", 61640, "u32"),
    ("DAC0", 61642, "f32"),
    ("DAC1_ENABLE", 61650, "u32"),
    ("DAC1", 61652, "f32"),
)
WATCHDOG = tuple(
    _rw(f"WATCHDOG_{name}_DEFAULT", address, kind) for name, address, kind in _SETTINGS
)
STRICT_CLEAR = _rw("WATCHDOG_STRICT_CLEAR", 61614)

# memory that the device leaves to its host: which host holds the bench, and its sign of life
SESSION = (_rw("USER_RAM0_U32", 46100), _rw("USER_RAM1_U32", 46102))


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
    text = (resources.files(__package__) / "error_names.txt").read_text(encoding="ascii")
    return dict(line.split() for line in text.splitlines())


def error_name(code: int) -> str:
    """Return name and number of an error code."""
    name = _error_names().get(str(code))
    return f"{name} ({code})" if name else f"error {code}"
