"""The emulated node on a TCP port: Modbus TCP framing on asyncio.

The framing shares no code with the host's, so that an error in either shows; it also knows which
connection asks, which sessions need.
"""

from __future__ import annotations

import asyncio
import itertools
import socket
import struct
from collections.abc import Callable

from hdbench.devices.emulator.answer import answer
from hdbench.devices.emulator.core import NodeCore

__all__ = ["NodeServer"]

_HEADER = struct.Struct(">HHHB")
# wall-clock grain of watchdog, real-time samples and deceleration
_TICK_S = 0.005
# a host that vanished without a word is noticed after 5 s and three probes, and loses its session
_KEEP_ALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 1, "TCP_KEEPCNT": 3}


class NodeServer:
    """Serves one node until it is closed.

    Parameters
    ----------
    core : NodeCore
        The node.
    """

    def __init__(self, core: NodeCore) -> None:
        self.core = core
        self._numbers = itertools.count(1)
        self._server: asyncio.Server | None = None
        self._timer: asyncio.TimerHandle | None = None

    async def open(self, host: str, port: int) -> tuple[str, int]:
        """Listen, and return host and port; port 0 takes a free one.

        Raises
        ------
        OSError
            If the address cannot be used.
        """
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(self._connection, host, port)
        self._tick(loop)
        name = self._server.sockets[0].getsockname()
        return str(name[0]), int(name[1])

    def close(self) -> None:
        """Stop listening and end every connection."""
        if self._timer is not None:
            self._timer.cancel()
        if self._server is not None:
            self._server.close()

    def _connection(self) -> asyncio.Protocol:
        return _Connection(self.core, next(self._numbers))

    def _tick(self, loop: asyncio.AbstractEventLoop) -> None:
        self.core.tick()
        self._timer = loop.call_later(_TICK_S, self._tick, loop)


class _Connection(asyncio.Protocol):
    """Framing of one connection."""

    def __init__(self, core: NodeCore, number: int) -> None:
        self._core = core
        self._number = number
        self._buffer = b""
        self._send: Callable[[bytes], None] = lambda _: None
        self._hang_up: Callable[[], None] = lambda: None
        self._later: Callable[[Callable[[], None]], object] = lambda _: None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep what sends."""
        _keep_alive(transport.get_extra_info("socket"))
        if isinstance(transport, asyncio.WriteTransport):
            self._send = transport.write
            self._hang_up = transport.close
        self._later = asyncio.get_running_loop().call_soon

    def data_received(self, data: bytes) -> None:
        """Answer every whole frame; hang up on a stream that is not Modbus TCP."""
        self._buffer += data
        while len(self._buffer) >= _HEADER.size:
            tid, protocol, length, unit = _HEADER.unpack_from(self._buffer)
            if protocol != 0 or not 2 <= length <= 254:
                self._hang_up()
                return
            end = 6 + length
            if len(self._buffer) < end:
                return
            pdu, self._buffer = self._buffer[_HEADER.size : end], self._buffer[end:]
            self._core.machine.tick()
            reply = answer(pdu, self._core, self._number)
            self._send(_HEADER.pack(tid, 0, len(reply) + 1, unit) + reply)
        # the reply is on its way: produce while the host works on it
        self._later(self._core.machine.produce_ahead)

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell the node that this host is gone."""
        self._core.disconnected(self._number)


def _keep_alive(connection: socket.socket) -> None:
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in _KEEP_ALIVE.items():
        if hasattr(socket, name):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
