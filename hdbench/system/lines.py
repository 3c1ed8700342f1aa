"""Serial ports without a wait, who else has them, processors kept awake, pseudo-terminals."""

from __future__ import annotations

import errno
import os
import re
import select
import socket
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Literal, Protocol

from hdbench.errors import BusyError, UsageError

if TYPE_CHECKING:
    from serial import Serial

FAST_BD = 115200
"""Bit rate above which a sleeping processor costs more than a hundredth of an exchange, bit/s.

It takes some 0.1 ms to wake, twice in an exchange: of 26 ms at 115200 bit/s, of 3.3 ms at 921600.
"""
# whoever holds it open says how long waking may take, us; Linux keeps to the shortest wish
_WISHES = "/dev/cpu_dma_latency"


def hold_wakeup() -> int | None:
    """Ask the kernel that no processor sleeps so deeply that waking takes time."""
    with suppress(OSError):
        descriptor = os.open(_WISHES, os.O_WRONLY)
        try:
            os.write(descriptor, struct.pack("=i", 0))
        except OSError:
            os.close(descriptor)
            raise
        return descriptor
    return None


def release_wakeup(held: int | None) -> None:
    """Take the wish back; never raises."""
    if held is not None:
        with suppress(OSError):
            os.close(held)


try:
    from termios import error as _setting_error
except ImportError:
    SETTING_ERRORS: tuple[type[Exception], ...] = ()
else:
    SETTING_ERRORS = (_setting_error,)
"""What pyserial lets through where a port does not take its settings."""

_CHUNK = 4096
# how often a port is looked at where it cannot be waited for, s
_LOOK_S = 5e-4
Claim = Literal["hold", "share"]
"""Have the port alone, or share it with whoever has it. Windows shares no port."""
# longest wait for characters to leave where a port takes them all or none, s
_WRITE_S = 1.0


class PortIo(Protocol):
    """What is done with an open port; only `readable` and `writable` wait."""

    def readable(self, wait_s: float) -> bool:
        """Return whether characters have come within this time."""

    def writable(self, wait_s: float) -> bool:
        """Return whether it takes characters within this time."""

    def read(self, size: int) -> bytes:
        """Return what has come, at most `size` characters."""

    def write(self, data: bytes) -> int:
        """Return how many characters it took."""

    def is_gone(self) -> bool:
        """Return whether a port that has just read as empty is gone."""

    def close(self) -> None:
        """Close the port."""


def port_io(port: Serial) -> PortIo:
    """Return what reads and writes an open port in the way of this system."""
    return _FileIo(port) if can_share_ports() else _PolledIo(port)


def socket_io(connection: socket.socket) -> PortIo:
    """Return what reads and writes a connection to a serial server, which then never waits."""
    connection.setblocking(False)
    return _SocketIo(connection)


class _PolledIo:
    """A port by pyserial alone."""

    def __init__(self, port: Serial) -> None:
        self._port = port

    def readable(self, wait_s: float) -> bool:
        until_s = time.monotonic() + wait_s
        while not self._port.in_waiting:
            if not time.monotonic() < until_s:
                return False
            time.sleep(_LOOK_S)
        return True

    def writable(self, wait_s: float) -> bool:
        return True

    def read(self, size: int) -> bytes:
        return bytes(self._port.read(min(size, self._port.in_waiting)))

    def write(self, data: bytes) -> int:
        return self._port.write(data) or 0

    def is_gone(self) -> bool:
        try:
            return self._port.in_waiting < 0
        except OSError:
            return True

    def close(self) -> None:
        self._port.close()


class _FileIo(_PolledIo):
    """A port that is a file."""

    def __init__(self, port: Serial) -> None:
        super().__init__(port)
        self._descriptor = port.fileno()

    def readable(self, wait_s: float) -> bool:
        return bool(select.select((self._descriptor,), (), (), max(0.0, wait_s))[0])

    def writable(self, wait_s: float) -> bool:
        return bool(select.select((), (self._descriptor,), (), max(0.0, wait_s))[1])

    def read(self, size: int) -> bytes:
        return os.read(self._descriptor, size)

    def write(self, data: bytes) -> int:
        try:
            return os.write(self._descriptor, data)
        except BlockingIOError:
            return 0

    def is_gone(self) -> bool:
        import termios

        try:
            termios.tcgetattr(self._descriptor)
        except termios.error:
            return True
        return False


class _SocketIo:
    """A connection to a serial server, as a port."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def readable(self, wait_s: float) -> bool:
        return bool(select.select((self._connection,), (), (), max(0.0, wait_s))[0])

    def writable(self, wait_s: float) -> bool:
        return bool(select.select((), (self._connection,), (), max(0.0, wait_s))[1])

    def read(self, size: int) -> bytes:
        data: bytes = self._connection.recv(size)
        if not data:
            raise OSError(0, "the device closed it")
        return data

    def write(self, data: bytes) -> int:
        try:
            return int(self._connection.send(data))
        except BlockingIOError:
            return 0

    def is_gone(self) -> bool:
        return False

    def close(self) -> None:
        self._connection.close()


def can_share_ports() -> bool:
    """Return whether two programs can have one serial port open; on Windows they cannot."""
    with suppress(ImportError):
        import termios  # noqa: F401 - asked for, not used

        return True
    return False


def may_open(path: str) -> bool:
    """Return whether this user may read and write a serial port; on Windows everybody may."""
    return not can_share_ports() or os.access(path, os.R_OK | os.W_OK)


def terminal_pair(*, blocking: bool = False) -> tuple[int, int, str]:
    """Open a pseudo-terminal that passes every character as it is."""
    try:
        import tty

        near, far = os.openpty()
    except (ImportError, AttributeError) as error:
        raise UsageError(
            "this system has no pseudo-terminals, and an emulated serial line needs one",
            where="emulated serial line",
            fix="emulate a bench on TCP, or connect a real serial port",
        ) from error
    tty.setraw(far)
    os.set_blocking(near, blocking)
    return near, far, os.ttyname(far)


class PseudoTerminal:
    """The device's end of an emulated serial line, in the running event loop.

    Parameters
    ----------
    received : callable
        Takes what a host has sent.

    Raises
    ------
    UsageError
        If the system has no pseudo-terminals.
    OSError
        If none is left.
    """

    def __init__(self, received: Callable[[bytes], None]) -> None:
        self._received = received
        self._near, self._far, self.path = terminal_pair()
        # the guard, which reads serial ports only, starts sooner without it
        import asyncio

        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._near, self._read)

    def write(self, data: bytes) -> int:
        """Return how many characters the line took; 0 while nobody reads and it is full."""
        try:
            return os.write(self._near, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """End the line."""
        self._loop.remove_reader(self._near)
        os.close(self._near)
        os.close(self._far)

    def _read(self) -> None:
        self._received(os.read(self._near, _CHUNK))


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
        return Serial(
            path,
            baudrate=baud_bd,
            bytesize=8 if pseudo else data_bits,
            parity="N" if pseudo else parity,
            stopbits=stop_bits,
            timeout=0,
            write_timeout=_WRITE_S,
            exclusive=claim != "share" or not can_share_ports(),
        )
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
