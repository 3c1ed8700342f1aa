"""A serial port, who else may have it, and whether it is still there."""

from __future__ import annotations

import errno
import os
import re
from typing import TYPE_CHECKING, Literal

from hdbench.errors import BusyError
from hdbench.system.lines import SETTING_ERRORS, can_share_ports, share_port

if TYPE_CHECKING:
    from serial import Serial

__all__ = ["Claim", "is_port", "open_port"]

Claim = Literal["hold", "ask", "share"]
"""Have the port alone; or refuse one that another program has, and keep nobody else away; or
share it with whoever has it. Windows shares no port."""

# longest wait for characters to leave where a port takes them all or none, s
_WRITE_S = 1.0


def open_port(
    path: str,
    where: str,
    *,
    baud_bd: int,
    data_bits: int = 8,
    parity: str = "N",
    stop_bits: float = 1,
    claim: Claim = "hold",
) -> Serial:
    """Open a port; reads and writes on it never wait."""
    from serial import Serial, SerialException

    # a pseudo-terminal has eight bits and no parity, and says so only when it is opened again
    pseudo = os.path.realpath(path).startswith("/dev/pts/")
    try:
        port = Serial(
            path,
            baudrate=baud_bd,
            bytesize=8 if pseudo else data_bits,
            parity="N" if pseudo else parity,
            stopbits=stop_bits,
            timeout=0,
            write_timeout=_WRITE_S,
            exclusive=claim != "share" or not can_share_ports(),
        )
        if claim == "ask":
            share_port(port)
        return port
    except SETTING_ERRORS as error:
        raise ValueError(str(error)) from error
    except SerialException as error:
        if error.errno in (errno.EAGAIN, errno.EBUSY):
            raise BusyError(
                "another program has the serial port open",
                where=where,
                fix="wait until it has finished, or stop it",
            ) from error
        raise


def is_port(name: str) -> bool:
    """Return whether a text names a serial port: a path, with colons too, or a COM port."""
    form = r"/[A-Za-z0-9._:,+@/-]+|COM[0-9]{1,3}"
    return re.fullmatch(form, name) is not None and ".." not in name
