"""Who answers: model, word order, serial number, checked before anything is written."""

from __future__ import annotations

from dataclasses import dataclass

from hdbench.devices.bench import Identity
from hdbench.drivers.labjack.control import Control
from hdbench.drivers.labjack.registers import IDENTITY, TEST, Register, user_name
from hdbench.drivers.labjack.table import LabJackAcquisition
from hdbench.errors import DeviceError

__all__ = ["EMULATOR_NAME", "TEST_VALUE", "check_identity"]

# what TEST reads where the words come in the right order (ljm_constants.json)
TEST_VALUE = 0x00112233
_SWAPPED = 0x22330011
# the device name that hdbench's own emulator answers with
EMULATOR_NAME = "hdbench-emulator"
_MODELS = {4: "T4", 7: "T7", 8: "T8"}


@dataclass(frozen=True, slots=True)
class _Found:
    product: int
    hardware: float
    firmware: float
    serial: int


def check_identity(control: Control, table: LabJackAcquisition) -> Identity:
    """Return who answers, if it is the device that the profile means."""
    (test,) = control.read(TEST)
    if test != TEST_VALUE:
        swapped = "; its words are swapped" if test == _SWAPPED else ""
        raise _error(
            control,
            f"reads 0x{int(test):08X}; needed: 0x{TEST_VALUE:08X}{swapped}",
            TEST,
            "this is no LabJack T-series device, or a gateway on the way swaps its words",
        )
    product, hardware, firmware, serial = control.read(*IDENTITY)
    found = _Found(round(product), float(hardware), float(firmware), int(serial))
    _check_model(control, found, table)
    name = _name(control)
    return Identity(
        vendor="LabJack",
        model=_MODELS[found.product],
        serial=str(found.serial),
        firmware=f"{found.firmware:.4f}",
        simulated=name == EMULATOR_NAME,
    )


def _check_model(control: Control, found: _Found, table: LabJackAcquisition) -> None:
    model = _MODELS.get(found.product, f"product {found.product}")
    if found.product not in (4, 7):
        raise _error(
            control,
            f"a {model} answers; this driver knows T4 and T7. A T8 keeps the constants that turn "
            "its streamed words into volts in a layout that has not been published for direct use",
            IDENTITY[0],
            "use a T4 or T7, or read a T8 through a driver of its maker's library",
        )
    if model != table.model:
        raise _error(
            control,
            f"a {model} answers; the profile names a {table.model}",
            IDENTITY[0],
            "correct daq.model or daq.address in the profile",
        )
    if table.serial_number is not None and found.serial != table.serial_number:
        raise _error(
            control,
            f"serial number {found.serial} answers; the profile names {table.serial_number}",
            IDENTITY[3],
            "correct daq.serial_number or daq.address in the profile",
        )


def _name(control: Control) -> str:
    """Return the device's name, control characters removed; empty where it tells none."""
    words = control.read_block(user_name())
    raw = b"".join(int(word).to_bytes(2, "big") for word in words)
    text = raw.split(b"\0")[0].decode("ascii", errors="replace")
    return "".join(char for char in text if char.isprintable())


def _error(control: Control, what: str, register: Register, fix: str) -> DeviceError:
    return DeviceError(what, where=f"{control.where}, register {register.describe()}", fix=fix)
