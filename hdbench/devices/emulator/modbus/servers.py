"""The emulated Modbus device on its wire: TCP, or RTU on a pseudo-terminal."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable

from hdbench.devices.emulator.modbus.device import ModbusDevice
from hdbench.devices.emulator.rtuserver import request_size
from hdbench.devices.wire.crc import crc16
from hdbench.system.lines import PseudoTerminal

__all__ = ["RtuServer", "TcpServer"]

_HEADER = struct.Struct(">HHHB")
# wall-clock grain of watchdog and motion, s
_TICK_S = 0.005
# after a damaged request nothing is answered until the line was quiet for this long, s
_QUIET_S = 0.005


class _Ticking:
    """Lets a device's time pass while nobody asks."""

    def __init__(self, device: ModbusDevice) -> None:
        self._device = device
        self._timer: asyncio.TimerHandle | None = None

    def start(self) -> None:
        self._device.tick()
        self._timer = asyncio.get_running_loop().call_later(_TICK_S, self.start)

    def end(self) -> None:
        if self._timer is not None:
            self._timer.cancel()


class TcpServer:
    """Serves one device on a TCP port until it is closed.

    Parameters
    ----------
    device : ModbusDevice
        The device.
    """

    def __init__(self, device: ModbusDevice) -> None:
        self.device = device
        self._ticking = _Ticking(device)
        self._server: asyncio.Server | None = None
        self._hosts: set[asyncio.WriteTransport] = set()

    async def open(self, host: str, port: int) -> str:
        """Listen, and return the address; port 0 takes a free one.

        Raises
        ------
        OSError
            If the address cannot be used.
        """
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(
            lambda: _Connection(self.device, self._hosts), host, port
        )
        self._ticking.start()
        name = self._server.sockets[0].getsockname()
        return f"tcp://{name[0]}:{name[1]}"

    def close(self) -> None:
        """Stop listening and end every connection."""
        self._ticking.end()
        if self._server is not None:
            self._server.close()
        for transport in tuple(self._hosts):
            transport.abort()


class _Connection(asyncio.Protocol):
    """Framing of one connection."""

    def __init__(self, device: ModbusDevice, hosts: set[asyncio.WriteTransport]) -> None:
        self._device = device
        self._hosts = hosts
        self._buffer = b""
        self._transport: asyncio.WriteTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep what sends."""
        if isinstance(transport, asyncio.WriteTransport):
            self._transport = transport
            self._hosts.add(transport)

    def data_received(self, data: bytes) -> None:
        """Answer every whole frame; hang up on a stream that is not Modbus TCP."""
        self._buffer += data
        while len(self._buffer) >= _HEADER.size and self._transport is not None:
            number, protocol, length, unit = _HEADER.unpack_from(self._buffer)
            if protocol != 0 or not 2 <= length <= 254:
                self._transport.close()
                return
            end = 6 + length
            if len(self._buffer) < end:
                return
            pdu, self._buffer = self._buffer[_HEADER.size : end], self._buffer[end:]
            if unit == self._device.unit:
                self._answer(pdu, number)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        if self._transport is not None:
            self._hosts.discard(self._transport)

    def _answer(self, pdu: bytes, number: int) -> None:
        reply = self._device.answer(pdu)
        if reply is None:
            return
        frame = _HEADER.pack(number, 0, len(reply) + 1, self._device.unit) + reply
        _later(self._device.reply_s, lambda: self._send(frame))

    def _send(self, frame: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(frame)


class RtuServer:
    """Serves one device on a pseudo-terminal until it is closed.

    Parameters
    ----------
    device : ModbusDevice
        The device.
    """

    def __init__(self, device: ModbusDevice) -> None:
        self.device = device
        self._ticking = _Ticking(device)
        self._line: PseudoTerminal | None = None
        self._buffer = b""
        self._deaf = False
        self._quiet: asyncio.TimerHandle | None = None

    async def open(self) -> str:
        """Open a pseudo-terminal and return the address that a host opens.

        Raises
        ------
        OSError
            If there is none.
        """
        self._line = PseudoTerminal(self._received)
        self._ticking.start()
        return f"rtu://{self._line.path}"

    def close(self) -> None:
        """End the line."""
        self._ticking.end()
        if self._quiet is not None:
            self._quiet.cancel()
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def _received(self, data: bytes) -> None:
        if self._deaf:
            self._turn_deaf()
            return
        self._buffer += data
        while (size := request_size(self._buffer)) is not None and len(self._buffer) >= size:
            frame, self._buffer = self._buffer[:size], self._buffer[size:]
            if not frame or crc16(frame[:-2]) != frame[-2:]:
                self._turn_deaf()
                return
            if frame[0] == self.device.unit:
                self._answer(frame[1:-2])

    def _answer(self, pdu: bytes) -> None:
        reply = self.device.answer(pdu)
        if reply is None:
            return
        body = bytes((self.device.unit,)) + reply
        _later(self.device.reply_s, lambda: self._send(body + crc16(body)))

    def _send(self, frame: bytes) -> None:
        if self._line is not None:
            # where nobody reads, the line is full, and the reply is lost as on a real one
            self._line.write(frame)

    def _turn_deaf(self) -> None:
        """Drop what came, and listen again once the line has been quiet."""
        self._buffer, self._deaf = b"", True
        if self._quiet is not None:
            self._quiet.cancel()
        self._quiet = asyncio.get_running_loop().call_later(_QUIET_S, self._listen)

    def _listen(self) -> None:
        self._deaf = False


def _later(wait_s: float, act: Callable[[], None]) -> None:
    """Do something after the device's own time for a reply."""
    if wait_s > 0.0:
        asyncio.get_running_loop().call_later(wait_s, act)
    else:
        act()
