"""Registers that the driver uses, and the device's own error codes.

Names, addresses, types and access are those of ``ljm_constants.json`` (LabJack Corporation, version
2025.12.18.A). All values are big-endian with the most significant word first.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Literal

Kind = Literal["u16", "u32", "i32", "f32"]
_FORMATS: dict[Kind, str] = {"u16": ">H", "u32": ">I", "i32": ">i", "f32": ">f"}


@dataclass(frozen=True, slots=True)
class Register:
    """One value of the device's flat map.

    Parameters
    ----------
    name : str
        LabJack's name.
    address : int
        Address of its first 16-bit register, 0-based.
    kind : {"u16", "u32", "i32", "f32"}
        Type.
    writable : bool
        Whether the driver ever writes it.
    flash : bool
        Whether the device keeps it in flash: written only where it differs.
    """

    name: str
    address: int
    kind: Kind
    writable: bool = False
    flash: bool = False

    @property
    def size(self) -> int:
        """Number of 16-bit registers."""
        return 1 if self.kind == "u16" else 2

    def encode(self, value: float) -> bytes:
        """Return the bytes of `value`."""
        try:
            if self.kind == "f32":
                return struct.pack(">f", value)
            return struct.pack(_FORMATS[self.kind], int(value))
        except (struct.error, OverflowError) as error:
            raise ValueError(f"{value!r} does not fit {self.name} ({self.kind})") from error

    def decode(self, raw: bytes) -> float | int:
        """Return the value of `raw`, exactly `size` registers."""
        value: float | int = struct.unpack(_FORMATS[self.kind], raw)[0]
        return value

    def describe(self) -> str:
        """Return name and address as messages show them."""
        return f"{self.name} ({self.address})"


def _rw(name: str, address: int, kind: Kind = "u32", *, flash: bool = False) -> Register:
    return Register(name, address, kind, writable=True, flash=flash)


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
    _rw(f"WATCHDOG_{name}_DEFAULT", address, kind, flash=True) for name, address, kind in _SETTINGS
)
STRICT_CLEAR = _rw("WATCHDOG_STRICT_CLEAR", 61614)

# memory that the device leaves to its host: which host holds the bench, and its sign of life
SESSION = (_rw("USER_RAM0_U32", 46100), _rw("USER_RAM1_U32", 46102))


def analog_input(number: int) -> Register:
    """Return AINn."""
    return Register(f"AIN{number}", 2 * number, "f32")


def analog_range(number: int) -> Register:
    """Return AINn_RANGE."""
    return _rw(f"AIN{number}_RANGE", 40000 + 2 * number, "f32")


def negative_channel(number: int) -> Register:
    """Return AINn_NEGATIVE_CH."""
    return _rw(f"AIN{number}_NEGATIVE_CH", 41000 + number, "u16")


def dac(number: int) -> Register:
    """Return DACn."""
    return _rw(f"DAC{number}", 1000 + 2 * number, "f32")


def tick_dac(number: int) -> Register:
    """Return TDACn."""
    return _rw(f"TDAC{number}", 30000 + 2 * number, "f32")


def digital_line(number: int) -> Register:
    """Return DIOn."""
    return _rw(f"DIO{number}", 2000 + number, "u16")


def ef_enable(number: int) -> Register:
    """Return DIOn_EF_ENABLE."""
    return _rw(f"DIO{number}_EF_ENABLE", 44000 + 2 * number)


def ef_index(number: int) -> Register:
    """Return DIOn_EF_INDEX."""
    return _rw(f"DIO{number}_EF_INDEX", 44100 + 2 * number)


def ef_count(number: int) -> Register:
    """Return DIOn_EF_READ_A."""
    return Register(f"DIO{number}_EF_READ_A", 3000 + 2 * number, "i32")


def scan_list(position: int) -> Register:
    """Return STREAM_SCANLIST_ADDRESSi."""
    return _rw(f"STREAM_SCANLIST_ADDRESS{position}", 4100 + 2 * position)


def flash_words(count: int) -> tuple[Register, ...]:
    """Return floats of the flash."""
    return tuple(Register("INTERNAL_FLASH_READ", FLASH_READ + 2 * n, "f32") for n in range(count))


def user_name() -> tuple[Register, ...]:
    """Return the registers of DEVICE_NAME_DEFAULT, two characters each."""
    return tuple(
        Register("DEVICE_NAME_DEFAULT", DEVICE_NAME + n, "u16")
        for n in range(DEVICE_NAME_REGISTERS)
    )


ERROR_NAMES = {
    2300: "MODBUS_RSP_OVERFLOW",
    2301: "MODBUS_CMD_OVERFLOW",
    2310: "MODBUS_STRING_CMD_TOO_BIG",
    2311: "MODBUS_STRING_PARAM_TOO_BIG",
    2312: "MODBUS_STRING_BAD_NUM_PARAMS",
    2313: "MODBUS_INVALID_NUM_REGISTERS",
    2314: "MODBUS_READ_TOO_LARGE",
    2315: "MODBUS_NUM_REGS_MUST_BE_EVEN",
    2316: "MODBUS_STRING_MISSING_NULL",
    2317: "UDP_DISCOVERY_ONLY_MODE_IS_ENABLED",
    2350: "INTFLASH_ADD_INVALID",
    2351: "INTFLASH_CODE_INVALID",
    2352: "INTFLASH_OP_PROHIBITED",
    2353: "INTFLASH_SECTION_OVERWRITE",
    2354: "INTFLASH_KEY_INVALID",
    2355: "FLASH_VERIFICATION_FAILED",
    2356: "FLASH_ERASE_FAILED",
    2358: "INTFLASH_UNAVAILABLE",
    2359: "FILEIO_UNAVAILABLE",
    2370: "AIN_RANGE_INVALID",
    2371: "AIN_SETTLING_INVALID",
    2372: "AIN_SET_TO_BINARY",
    2373: "AIN_NEGATIVE_CHANNEL_INVALID",
    2374: "AIN_ALL_ZERO_ONLY",
    2375: "AIN_RESOLUTION_INVALID",
    2376: "AIN_RATE_INVALID",
    2377: "AIN_CHN_DISABLED",
    2400: "SYSTEM_MEMORY_BEREFT",
    2401: "SYSTEM_MEMORY_OVERWRITE",
    2402: "SYSTEM_REBOOT_CODE_INVALID",
    2403: "SYSTEM_READ_OVERRUN",
    2404: "SYSTEM_INVALID_PIN",
    2405: "SYSTEM_NVRAM_UNAVAILABLE",
    2406: "SYSTEM_NVRAM_INVALID_ADDRESS",
    2407: "SYSTEM_WAIT_TOO_LONG",
    2408: "SYSTEM_INCOMPATIBLE_FIRMWARE_VERSION",
    2409: "SYSTEM_VS_TOO_LOW",
    2500: "HW_DIO_NOT_AVAILABLE",
    2501: "DIO_SET_TO_ANALOG",
    2508: "HW_CNTRA_NOT_AVAILABLE",
    2509: "HW_CNTRB_NOT_AVAILABLE",
    2510: "HW_CNTRC_NOT_AVAILABLE",
    2511: "HW_CNTRD_NOT_AVAILABLE",
    2520: "HW_CIO0_NOT_AVAILABLE",
    2521: "HW_CIO1_NOT_AVAILABLE",
    2523: "HW_DAC1_NOT_AVAILABLE",
    2524: "HW_LEDS_NOT_AVAILABLE",
    2550: "EF_DIO_HAS_NO_TNC_FEATURES",
    2551: "EF_INVALID_TYPE",
    2552: "EF_TYPE_NOT_SUPPORTED",
    2553: "EF_PIN_TYPE_MISMATCH",
    2554: "EF_CLOCK_SOURCE_NOT_ENABLED",
    2555: "EF_32BIT_DATA_INTO_16BIT_REG",
    2556: "EF_SET_TO_32BIT",
    2557: "EF_SMOOTH_VALUE_OUT_OF_RANGE",
    2558: "EF_32BIT_REQUIRES_BOTH_CLOCK0and1",
    2559: "EF_DIVISOR_VALUE_INVALID",
    2560: "EF_PIN_RESERVED",
    2561: "EF_INVALID_DIO_NUMBER",
    2563: "EF_LINE_MUST_BE_LOW_BEFORE_STARTING",
    2564: "EF_INVALID_DIVISOR",
    2565: "EF_VALUE_GREATER_THAN_PERIOD",
    2566: "EF_CAN_NOT_CHANGE_INDEX_WHILE_ENABLED",
    2600: "STREAM_NEED_AT_LEAST_ONE_CHN",
    2601: "STREAM_CLOCK_BASE_NOT_WRITABLE",
    2602: "STREAM_EXTCLK_AND_GATE_MX",
    2603: "STREAM_IN_SPONTANEOUS_MODE",
    2604: "STREAM_USB_PKT_OVERFLOW",
    2605: "STREAM_IS_ACTIVE",
    2606: "STREAM_CONFIG_INVALID",
    2607: "STREAM_CHN_LIST_INVALID",
    2608: "STREAM_SCAN_RATE_INVALID",
    2609: "STREAM_OUT_BUFF_TOO_BIG",
    2610: "STREAM_OUT_NUM_INVALID",
    2611: "STREAM_DATA_TYPE_INVALID",
    2612: "STREAM_TARGET_CONFIG_INVALID",
    2613: "STREAM_OUT_BUFF_FULL",
    2614: "STREAM_OUT_TARGET_INVALID",
    2615: "STREAM_BUFF_SIZE_INVALID",
    2616: "STREAM_OUT_BUFF_LOOP_OVERWRITE",
    2617: "STREAM_OUT_BUFF_DNE",
    2618: "STREAM_SAMPLES_PER_PKT_INVALID",
    2619: "STREAM_BUFFER_DNE",
    2620: "STREAM_NOT_RUNNING",
    2621: "STREAM_SETTLING_INVALID",
    2622: "STREAM_OUT_LOOP_TOO_BIG",
    2623: "STREAM_OUT_DATA_TRGT_MISSMATCH",
    2624: "STREAM_INVALID_DIVISOR",
    2625: "STREAM_CHN_CAN_NOT_BE_STREAMED",
    2626: "STREAM_OUT_DAC_IN_USE",
    2627: "STREAM_OUT_NEEDS_TO_BE_ENABLED",
    2628: "CANNOT_STREAM_FAST_WITH_DAC1_FREQUENCY_OUT_ENABLED",
    2629: "CANNOT_ENABLE_DAC1_FREQUENCY_OUT_WITH_FAST_STREAM",
    2630: "STREAM_TRIGGER_INDEX_INVALID",
    2631: "STREAM_RATE_INVALID_FOR_TEMPERATURE_SENSOR",
    2632: "STREAM_SUB_SOLUTION_NOT_FOUND",
    2670: "SWDT_ROLLT_INVALID",
    2671: "SWDT_ENABLED",
    2672: "SWDT_DIO_SETTINGS_INVALID",
    2673: "SWDT_DAC0_SETTINGS_INVALID",
    2674: "SWDT_DAC1_SETTINGS_INVALID",
    2760: "TDAC_SDA_SCL_INVALID",
    2761: "TDAC_SCL_INVALID",
    2762: "TDAC_INVALID_CHANNEL",
    2763: "TDAC_CAL_READ_FAILURE",
    2764: "TDAC_NOT_FOUND",
    2765: "TDAC_NOT_INITIALIZED",
    2940: "STREAM_AUTO_RECOVER_ACTIVE",
    2941: "STREAM_AUTO_RECOVER_END",
    2942: "STREAM_SCAN_OVERLAP",
    2943: "STREAM_AUTO_RECOVER_END_OVERFLOW",
    2944: "STREAM_BURST_COMPLETE",
    2945: "STREAM_BUFFER_FULL",
}


def error_name(code: int) -> str:
    """Return name and number of an error code."""
    name = ERROR_NAMES.get(code)
    return f"{name} ({code})" if name else f"error {code}"
