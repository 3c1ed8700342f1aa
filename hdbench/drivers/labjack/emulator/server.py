"""The emulated device on two TCP ports: control and stream, with framing of its own."""

from __future__ import annotations

import asyncio
import errno
import struct
from collections.abc import Callable

from hdbench.drivers.labjack.emulator.device import LabJackDevice
from hdbench.drivers.labjack.emulator.memory import RefusedError

__all__ = ["STREAM_OFFSET", "LabJackServer"]

# 502 and 702
STREAM_OFFSET = 200
_HEADER = struct.Struct(">HHHB")
# wall-clock grain of stream, watchdog and motion, s
_TICK_S = 0.005
_MAX_PDU = 1040
_ILLEGAL_FUNCTION, _ILLEGAL_VALUE = 1, 3
# a reader that has not taken this much is slow: packets then wait in the device's buffer
_SLOW_BYTES = 16384
_PORT_TRIES = 50
_HIGHEST_PORT = 65535


class LabJackServer:
    """Serves one device until it is closed.

    Parameters
    ----------
    device : LabJackDevice
        The device.
    """

    def __init__(self, device: LabJackDevice) -> None:
        self.device = device
        self.change_packets: Callable[[bytes], list[bytes]] = lambda packet: [packet]
        self._servers: list[asyncio.Server] = []
        self._timer: asyncio.TimerHandle | None = None
        self._readers: set[asyncio.WriteTransport] = set()
        self._hosts: set[asyncio.WriteTransport] = set()
        device.rebooted = self._hang_up

    async def open(self, host: str, port: int) -> tuple[str, int]:
        """Listen on `port` and on `port` + 200; port 0 takes a free pair.

        Returns
        -------
        tuple of str and int
            Host and control port.

        Raises
        ------
        OSError
            If the ports cannot be used.
        """
        loop = asyncio.get_running_loop()
        for attempt in range(1, _PORT_TRIES + 1):
            control = await loop.create_server(lambda: _Control(self), host, port)
            bound = int(control.sockets[0].getsockname()[1])
            try:
                if bound + STREAM_OFFSET > _HIGHEST_PORT:
                    raise OSError(errno.EADDRNOTAVAIL, "no port left for the stream")
                stream = await loop.create_server(
                    lambda: _Reader(self._readers), host, bound + STREAM_OFFSET
                )
            except OSError:
                control.close()
                if port or attempt == _PORT_TRIES:
                    raise
                continue
            break
        self._servers = [control, stream]
        self._tick(loop)
        return host, bound

    def close(self) -> None:
        """Stop listening and end every connection."""
        if self._timer is not None:
            self._timer.cancel()
        for server in self._servers:
            server.close()
        self._hang_up()

    def answer(self, pdu: bytes, transaction: int) -> bytes:
        """Return the reply to one request."""
        self.device.watchdog.heard()
        self.device.watchdog.tick()
        try:
            return self._carry_out(pdu)
        except RefusedError as refused:
            self.device.note_error(refused, transaction)
            return bytes((pdu[0] | 0x80, refused.exception))
        except (struct.error, IndexError):
            # shorter than its function code asks for
            return bytes((pdu[0] | 0x80, _ILLEGAL_VALUE))

    def pump(self) -> None:
        """Let the device act, and send the packets that are complete."""
        # with nobody there yet, packets wait in the device's buffer, too
        slow = not self._readers or any(
            reader.get_write_buffer_size() > _SLOW_BYTES for reader in self._readers
        )
        held, stream = self.device.stream.hold, self.device.stream
        stream.hold = held or slow
        packets = self.device.tick()
        stream.hold = held
        for packet in packets:
            for changed in self.change_packets(packet):
                for reader in self._readers:
                    reader.write(changed)

    def joined(self, transport: asyncio.WriteTransport) -> None:
        """Note a host's connection."""
        self._hosts.add(transport)

    def left(self, transport: asyncio.WriteTransport | None) -> None:
        """Note that a host's connection is gone."""
        if transport is not None:
            self._hosts.discard(transport)

    def _carry_out(self, pdu: bytes) -> bytes:
        function, memory = pdu[0], self.device.memory
        if function == 3:
            address, count = struct.unpack(">HH", pdu[1:])
            raw = self._swapped(memory.read(address, count))
            return bytes((3, 2 * count)) + raw
        if function == 6:
            address, _ = struct.unpack(">HH", pdu[1:])
            memory.write(address, pdu[3:])
            return pdu
        if function == 16:
            address, count, n_bytes = struct.unpack(">HHB", pdu[1:6])
            if n_bytes != 2 * count or len(pdu) != 6 + n_bytes:
                raise RefusedError(_ILLEGAL_VALUE, _ILLEGAL_VALUE)
            memory.write(address, pdu[6:])
            return pdu[:5]
        if function == 76:
            return b"\x4c" + self._feedback(pdu[1:])
        raise RefusedError(_ILLEGAL_FUNCTION, _ILLEGAL_FUNCTION)

    def _feedback(self, frames: bytes) -> bytes:
        reply = b""
        while frames:
            kind, address, count = struct.unpack(">BHB", frames[:4])
            frames = frames[4:]
            if kind == 0:
                reply += self._swapped(self.device.memory.read(address, count))
            elif kind == 1 and len(frames) >= 2 * count:
                self.device.memory.write(address, frames[: 2 * count])
                frames = frames[2 * count :]
            else:
                raise RefusedError(_ILLEGAL_VALUE, _ILLEGAL_VALUE)
        return reply

    def _swapped(self, raw: bytes) -> bytes:
        """Return 32-bit values with their words swapped, where a gateway is to do that."""
        if not self.device.swap_words or len(raw) % 4:
            return raw
        return b"".join(raw[n + 2 : n + 4] + raw[n : n + 2] for n in range(0, len(raw), 4))

    def _hang_up(self) -> None:
        for transport in (*self._hosts, *self._readers):
            transport.abort()

    def _tick(self, loop: asyncio.AbstractEventLoop) -> None:
        self.pump()
        self._timer = loop.call_later(_TICK_S, self._tick, loop)


class _Control(asyncio.Protocol):
    """Framing of one control connection."""

    def __init__(self, server: LabJackServer) -> None:
        self._server = server
        self._buffer = b""
        self._transport: asyncio.WriteTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep what sends."""
        if isinstance(transport, asyncio.WriteTransport):
            self._transport = transport
            self._server.joined(transport)

    def data_received(self, data: bytes) -> None:
        """Answer every whole frame; hang up on a stream that is not Modbus TCP."""
        self._buffer += data
        while len(self._buffer) >= _HEADER.size and self._transport is not None:
            number, protocol, length, unit = _HEADER.unpack_from(self._buffer)
            if protocol != 0 or not 2 <= length <= _MAX_PDU:
                self._transport.close()
                return
            end = 6 + length
            if len(self._buffer) < end:
                return
            pdu, self._buffer = self._buffer[_HEADER.size : end], self._buffer[end:]
            reply = self._server.answer(pdu, number)
            self._transport.write(_HEADER.pack(number, 0, len(reply) + 1, unit) + reply)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        self._server.left(self._transport)


class _Reader(asyncio.Protocol):
    """One connection to the stream; nothing that it sends matters."""

    def __init__(self, readers: set[asyncio.WriteTransport]) -> None:
        self._readers = readers
        self._transport: asyncio.WriteTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Send to it from now on."""
        if isinstance(transport, asyncio.WriteTransport):
            self._transport = transport
            self._readers.add(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Send nothing more to it."""
        if self._transport is not None:
            self._readers.discard(self._transport)
