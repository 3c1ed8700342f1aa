"""Serial ports of this computer, and known devices on them."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from hdbench.devices.driver import probes
from hdbench.errors import BusyError, HdbenchError
from hdbench.system.lines import may_open


@dataclass(frozen=True, slots=True)
class SerialPort:
    """One serial port.

    Parameters
    ----------
    path : str
        Device file.
    description, manufacturer, serial_number : str
        As the USB device tells them, control characters removed; empty where it does not.
    usb_id : str
        Vendor and product, such as ``0403:6001``; empty without USB.
    accessible : bool
        Whether this user may read and write it.
    latency_ms : int or None
        Time for which an FTDI adapter holds back characters, ms; None where there is no such timer.
    """

    path: str
    description: str
    manufacturer: str
    serial_number: str
    usb_id: str
    accessible: bool
    latency_ms: int | None


def find_ports() -> tuple[SerialPort, ...]:
    """Return the serial ports of this computer; nothing is opened or sent."""
    from serial.tools.list_ports import comports

    found = [
        SerialPort(
            path=str(port.device),
            description=_text(port.description),
            manufacturer=_text(port.manufacturer),
            serial_number=_text(port.serial_number),
            usb_id="" if port.vid is None else f"{port.vid:04x}:{port.pid or 0:04x}",
            accessible=may_open(str(port.device)),
            latency_ms=latency_timer_ms(str(port.device)),
        )
        for port in comports()
    ]
    return tuple(sorted(found, key=lambda port: (not port.usb_id, port.path)))


def latency_timer_ms(path: str, root: Path = Path("/sys/bus/usb-serial/devices")) -> int | None:
    """Return for how long a USB adapter holds back characters, ms."""
    file = root / Path(os.path.realpath(path)).name / "latency_timer"
    try:
        return int(file.read_text().strip())
    except (OSError, ValueError):
        return None


def probe_port(port: SerialPort) -> str:
    """Ask who is on a port, as every installed driver asks that knows a serial device."""
    reason = "nobody that hdbench knows answers"
    for ask in probes():
        try:
            who = ask(port.path)
        except BusyError as error:
            return error.what
        except (HdbenchError, OSError, ValueError) as error:
            reason = reason if isinstance(error, HdbenchError) else f"cannot be opened ({error})"
        else:
            if who:
                return who
    return reason


def _text(value: object) -> str:
    """Return a text that a device told without control characters."""
    text = "" if value is None else str(value)
    return "" if text == "n/a" else "".join(char for char in text if char.isprintable())[:80]
