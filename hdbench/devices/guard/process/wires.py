"""Modbus on a connection of the guard's own: TCP, TLS, or the serial line."""

from __future__ import annotations

import os
import select
import socket
import struct
import time
from typing import Any

# one try of a transaction, s; on a serial line so much beside the characters themselves
REPLY_S = 0.25
# the longest request and reply, bits
_LONGEST_BITS = 2 * 256 * 12


class WireError(Exception):
    """What went wrong on the wire."""


class TcpWire:
    """Modbus TCP, or TLS."""

    def __init__(self, target: dict[str, Any]) -> None:
        self._unit = int(target["unit"])
        self._rest_s = float(target["rest_s"])
        self._number = 0
        raw = socket.create_connection((target["host"], target["port"]), REPLY_S)
        raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = _secured(raw, target["tls"]) if target["tls"] else raw

    def transact(self, pdu: bytes) -> bytes:
        """Send one request and return the PDU of its reply."""
        time.sleep(self._rest_s)
        self._number = self._number % 0xFFFF + 1
        head = struct.pack(">HHHB", self._number, 0, len(pdu) + 1, self._unit)
        until_s = time.monotonic() + REPLY_S
        self._socket.settimeout(REPLY_S)
        self._socket.sendall(head + pdu)
        while True:
            number, protocol, length, _ = struct.unpack(">HHHB", self._exactly(7, until_s))
            if protocol != 0 or not 2 <= length <= 254:
                raise WireError("no Modbus TCP")
            reply = self._exactly(length - 1, until_s)
            if number == self._number:
                return reply

    def _exactly(self, size: int, until_s: float) -> bytes:
        data = b""
        while len(data) < size:
            left_s = until_s - time.monotonic()
            if not left_s > 0.0:
                raise WireError("no reply in time")
            self._socket.settimeout(left_s)
            chunk = self._socket.recv(size - len(data))
            if not chunk:
                raise WireError("the device hung up")
            data += chunk
        return data

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


class RtuWire:
    """Modbus RTU on the serial line, which the session does not use at this time.

    Parameters
    ----------
    target : dict
        Where and how.
    alone : bool
        Whether the session is gone, so that whoever has the port now is another program: it is left
        in peace then.
    """

    def __init__(self, target: dict[str, Any], *, alone: bool) -> None:
        self._unit = bytes((int(target["unit"]),))
        self._silence_s = max(float(target["silence_s"]), float(target["rest_s"]))
        self._reply_s = REPLY_S + _LONGEST_BITS / int(target["baud_bd"])
        self._handle = os.open(target["path"], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            if alone and _taken(self._handle):
                raise WireError("another program has the serial port")
            _set_line(self._handle, target)
        except (WireError, OSError):
            self.close()
            raise

    def transact(self, pdu: bytes) -> bytes:
        """Send one request after a silence and return the PDU of its reply."""
        until_s = time.monotonic() + self._silence_s + self._reply_s
        while self._readable(min(self._silence_s, until_s - time.monotonic())):
            self._take()
        frame = self._unit + pdu
        os.write(self._handle, frame + crc16(frame))
        data, until_s = b"", time.monotonic() + self._reply_s
        while self._readable(until_s - time.monotonic()):
            data += self._take()
            if len(data) >= 5 and data[:1] == self._unit and crc16(data[:-2]) == data[-2:]:
                return data[1:-2]
        raise WireError("no valid reply in time")

    def _readable(self, wait_s: float) -> bool:
        return wait_s > 0.0 and bool(select.select([self._handle], [], [], wait_s)[0])

    def _take(self) -> bytes:
        data = os.read(self._handle, 4096)
        if not data and _hung_up(self._handle):
            raise WireError("the serial port was unplugged")
        return data

    def close(self) -> None:
        """Close the port."""
        os.close(self._handle)


def open_wire(target: dict[str, Any], *, alone: bool) -> TcpWire | RtuWire:
    """Return a connection to a target; `alone` as `RtuWire` takes it."""
    return RtuWire(target, alone=alone) if target["wire"] == "rtu" else TcpWire(target)


def crc16(data: bytes) -> bytes:
    """Return the checksum of Modbus RTU, low byte first."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return struct.pack("<H", value)


def _secured(raw: socket.socket, files: dict[str, Any]) -> socket.socket:
    import ssl

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.load_verify_locations(files["authority"])
    context.load_cert_chain(files["certificate"], files["key"])
    return context.wrap_socket(raw, server_hostname=files["server_name"])


def _taken(handle: int) -> bool:
    """Return whether a living process has locked the port, as every program here does."""
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    # a person who wants to stop the motor by another command is not kept from it
    fcntl.flock(handle, fcntl.LOCK_UN)
    return False


def _hung_up(handle: int) -> bool:
    """Return whether the port is gone; where it is not, somebody else took what came."""
    import termios

    try:
        termios.tcgetattr(handle)
    except termios.error:
        return True
    return False


def _set_line(handle: int, target: dict[str, Any]) -> None:
    """Set bit rate, parity and stop bits; a closed USB port forgets them."""
    import termios

    speed = getattr(termios, f"B{target['baud_bd']}", None)
    flags = termios.CS8 | termios.CREAD | termios.CLOCAL
    if not os.path.realpath(target["path"]).startswith("/dev/pts/"):
        flags |= 0 if target["parity"] == "N" else termios.PARENB
        flags |= termios.PARODD if target["parity"] == "O" else 0
    flags |= termios.CSTOPB if target["stop_bits"] == 2 else 0
    try:
        settings = termios.tcgetattr(handle)
        rates = settings[4:6] if speed is None else [speed, speed]
        termios.tcsetattr(handle, termios.TCSANOW, [0, 0, flags, 0, *rates, settings[6]])
    except termios.error as error:
        raise WireError(f"the port does not take its settings ({error.args[-1]})") from error
