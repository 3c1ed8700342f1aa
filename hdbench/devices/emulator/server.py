"""Server of emulated devices: that of pymodbus, with a number for each host."""

from __future__ import annotations

import asyncio
import itertools
import math
import socket
import struct
from abc import ABC, abstractmethod
from typing import Any, Literal

from hdbench.devices import pymodbusparts as pm
from hdbench.devices.registers import Space
from hdbench.system.lines import PseudoTerminal

Wire = Literal["tcp", "udp", "rtu", "rtu+tcp", "ascii"]
"""What an emulated device speaks; ``rtu`` and ``ascii`` on a pseudo-terminal."""

_WIRES: dict[Wire, tuple[pm.CommType, pm.FramerType]] = {
    "tcp": (pm.CommType.TCP, pm.FramerType.SOCKET),
    "udp": (pm.CommType.UDP, pm.FramerType.SOCKET),
    "rtu": (pm.CommType.SERIAL, pm.FramerType.RTU),
    "rtu+tcp": (pm.CommType.TCP, pm.FramerType.RTU),
    "ascii": (pm.CommType.SERIAL, pm.FramerType.ASCII),
}
_SPACES: dict[int, Space] = {
    1: "coil", 2: "discrete", 3: "holding", 4: "input",
    5: "coil", 6: "holding", 16: "holding", 23: "holding",
}  # fmt: skip
_READS = (1, 2, 3, 4)
# where the values of a write begin in function code and data
_VALUES_AT = {5: 3, 6: 3, 16: 6, 23: 10}
_MAX_WRITTEN = 123
_ILLEGAL_FUNCTION, _ILLEGAL_VALUE = 1, 3
_DECODER = pm.DecodePDU(True)
_HEADER = struct.Struct(">HH")
# wall-clock grain of watchdogs, real-time samples and motion, s
_TICK_S = 0.005
# on a serial line what is no whole request by then is none, s
_QUIET_S = 0.02
# a serial line shows no host go: without a request for this long it counts as gone, s
_SILENCE_S = 2.0
# a host that vanished without a word is noticed after 5 s and three probes
_KEEP_ALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 1, "TCP_KEEPCNT": 3}
_CHUNK = 4096


class ModbusRefusedError(Exception):
    """A request that the device answers with an exception.

    Parameters
    ----------
    exception : int
        Modbus exception code.
    reason : int or None
        The device's own code; None where the request is none as Modbus has it.
    address : int
        First register concerned.
    """

    def __init__(self, exception: int, reason: int | None = None, address: int = 0) -> None:
        super().__init__(f"exception {exception}")
        self.exception, self.reason, self.address = exception, reason, address


class Device(ABC):
    """Registers and bits behind a server; each connection of a host has its number.

    Attributes
    ----------
    functions : frozenset of int
        Function codes that it knows.
    unit : int or None
        Unit identifier; None answers to any.
    reply_s : float
        Its own time for a reply, s.
    longest : int
        Longest request on TCP, bytes of unit, function code and data.
    """

    functions: frozenset[int]
    unit: int | None = None
    reply_s: float = 0.0
    longest = 254

    @abstractmethod
    def read(self, space: Space, address: int, count: int, connection: int) -> bytes:
        """Return registers, or bits packed from the lowest on."""

    @abstractmethod
    def write(self, space: Space, address: int, raw: bytes, connection: int) -> None:
        """Write registers, or one bit as 0xFF00 or 0."""

    @abstractmethod
    def tick(self) -> None:
        """Let time pass."""

    def hears(self, function: int) -> bool:
        """Note a request before it is carried out; False leaves it without a reply."""
        return True

    def other(self, pdu: bytes) -> bytes:
        """Return the data of the reply to a function that Modbus does not define."""
        raise ModbusRefusedError(_ILLEGAL_FUNCTION)

    def note_refusal(self, refused: ModbusRefusedError, connection: int, transaction: int) -> None:
        """Keep the reason of a refusal."""
        return

    def left(self, connection: int) -> None:
        """Note that a host is gone."""
        return

    def rest(self) -> None:
        """Do what can be done while the host works on a reply."""
        return

    def answer(self, pdu: bytes, connection: int, transaction: int = 0) -> bytes | None:
        """Return the reply to one request."""
        if not self.hears(pdu[0]):
            return None
        try:
            return pdu[:1] + self._carry_out(pdu, connection)
        except ModbusRefusedError as refused:
            self.note_refusal(refused, connection, transaction)
            return bytes((pdu[0] | 0x80, refused.exception))

    def _carry_out(self, pdu: bytes, connection: int) -> bytes:
        """Return the data of a reply."""
        function = pdu[0]
        if function not in self.functions:
            raise ModbusRefusedError(_ILLEGAL_FUNCTION)
        if function not in _SPACES:
            return self.other(pdu)
        request: Any = _DECODER.decode(pdu)
        # pymodbus reads generously: a request must be what it makes of it itself, to the byte
        try:
            same = request is not None and request.encode() == pdu[1:]
        except (ValueError, struct.error):
            same = False
        if not same or (function == 16 and not 1 <= request.count <= _MAX_WRITTEN):
            raise ModbusRefusedError(_ILLEGAL_VALUE)
        space = _SPACES[function]
        if function in _READS:
            return _counted(self.read(space, request.address, request.count, connection))
        values = pdu[_VALUES_AT[function] :]
        if function != 23:
            self.write(space, request.address, values, connection)
            return pdu[1:5]
        self.write(space, request.write_address, values, connection)
        return _counted(self.read(space, request.read_address, request.read_count, connection))


def _counted(raw: bytes) -> bytes:
    return bytes((len(raw),)) + raw


class ModbusServer:
    """Serves one device until it is closed.

    Parameters
    ----------
    device : Device
        The device.
    wire : str, optional
        What it speaks.
    """

    def __init__(self, device: Device, wire: Wire = "tcp") -> None:
        self.device = device
        self._wire = wire
        self._listener: _Listener | None = None
        self._timer: asyncio.TimerHandle | None = None

    async def open(self, host: str = "127.0.0.1", port: int = 0) -> str:
        """Listen, and return the address that a host opens; port 0 takes a free one."""
        self._listener = _Listener(self.device, self._wire, host, port)
        place = await self._listener.open()
        self._tick(asyncio.get_running_loop())
        return f"{self._wire}://{place}"

    def hang_up(self) -> None:
        """End every connection at once; others may come."""
        connections = {} if self._listener is None else self._listener.active_connections
        for connection in tuple(connections.values()):
            if isinstance(connection.transport, asyncio.WriteTransport):
                connection.transport.abort()

    def close(self) -> None:
        """Stop listening and end every connection."""
        if self._timer is not None:
            self._timer.cancel()
        if self._listener is not None:
            self._listener.close()

    def _tick(self, loop: asyncio.AbstractEventLoop) -> None:
        self.device.tick()
        if self._listener is not None:
            self._listener.forget_silent()
        self._timer = loop.call_later(_TICK_S, self._tick, loop)


class _Listener(pm.ModbusBaseServer):
    """What hosts connect to."""

    def __init__(self, device: Device, wire: Wire, host: str, port: int) -> None:
        kind, framer = _WIRES[wire]
        # pymodbus wants a data store of its own; nothing asks it
        store = pm.SimDevice(0, [pm.SimData(0, values=[0], datatype=pm.DataType.REGISTERS)])
        place = pm.CommParams(comm_type=kind, comm_name="emulator", source_address=(host, port))
        super().__init__(place, store, True, False, None, framer, None, None, None, None)
        self.device = device
        self.wire = wire
        self.numbers = itertools.count(1)
        if kind == pm.CommType.SERIAL:
            self.call_create = self._terminal

    async def open(self) -> str:
        """Listen, and return where."""
        self.is_listener = True
        made = await self.call_create()
        self.transport = made[0] if isinstance(made, tuple) else made
        if isinstance(made, asyncio.Server):
            name = made.sockets[0].getsockname()
        elif isinstance(self.transport, _Terminal):
            return self.transport.path
        else:
            name = self.transport.get_extra_info("sockname")
        host = f"[{name[0]}]" if ":" in name[0] else name[0]
        return f"{host}:{name[1]}"

    def callback_new_connection(self) -> _Connection:
        """Return what serves one more host."""
        return _Connection(self)

    def forget_silent(self) -> None:
        """Tell the device of a host on a serial line that has gone."""
        for connection in self.active_connections.values():
            if isinstance(connection, _Connection) and connection.is_forgotten():
                self.device.left(connection.number)

    async def _terminal(self) -> tuple[_Terminal, _Connection]:
        connection = _Connection(self)
        self.active_connections[connection.unique_id] = connection
        connection.listener = self
        return _Terminal(connection), connection


class _Connection(pm.ServerRequestHandler):
    """One host."""

    def __init__(self, owner: _Listener) -> None:
        super().__init__(owner, None, None, None)  # type: ignore[no-untyped-call]
        self.number = next(owner.numbers)
        self._device = owner.device
        self._wire = owner.wire
        self._on_line = owner.wire in ("rtu", "ascii")
        self._heard_s: float | None = None

    def is_forgotten(self) -> bool:
        """Return, once, whether a serial line has been silent for long."""
        silent = (
            self._on_line
            and self._heard_s is not None
            and self.loop.time() - self._heard_s > _SILENCE_S
        )
        if silent:
            self._heard_s = None
        return silent

    def callback_connected(self) -> None:
        """Notice it when the host vanishes."""
        super().callback_connected()
        connection = self.transport.get_extra_info("socket")
        if connection is not None and self._wire in ("tcp", "rtu+tcp"):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for name, value in _KEEP_ALIVE.items():
                if hasattr(socket, name):
                    connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)

    def callback_disconnected(self, exc: Exception | None) -> None:
        """Tell the device that this host is gone."""
        super().callback_disconnected(exc)
        self._device.left(self.number)

    def data_received(self, data: bytes) -> None:
        """Take what came on a stream or a line."""
        self.datagram_received(data, None)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take what came; on a line that was silent it begins a request."""
        if self._on_line:
            now_s = self.loop.time()
            if now_s - (self._heard_s or -math.inf) > _QUIET_S:
                self.recv_buffer = b""
            self._heard_s = now_s
        data = self.recv_buffer + data
        self.recv_buffer = data[self.callback_data(data, addr) :][:_CHUNK]

    def callback_data(self, data: bytes, addr: Any = None) -> int:
        """Answer every whole request; return how much of `data` is done with."""
        used, decode = 0, self.framer.decode
        while used < len(data):
            rest = data[used:]
            if self._wire == "tcp" and len(rest) >= 6:
                protocol, length = _HEADER.unpack_from(rest, 2)
                if protocol or not 2 <= length <= self._device.longest:
                    # not Modbus TCP
                    self.transport.close()
                    return len(data)
            try:
                size, unit, transaction, pdu = decode(rest)
            except (pm.ModbusException, ValueError):
                # nothing that a request begins with
                return len(data)
            if not size:
                break
            used += size
            if pdu and self._device.unit in (None, unit):
                self._answer(pdu, unit, transaction, addr)
        return len(data) if self._wire == "udp" else used

    def _answer(self, pdu: bytes, unit: int, transaction: int, addr: Any) -> None:
        reply = self._device.answer(pdu, self.number, transaction)
        if reply is None:
            return
        frame = self.framer.encode(reply, unit, transaction)
        if self._device.reply_s > 0.0:
            self.loop.call_later(self._device.reply_s, self._put, frame, addr)
        else:
            self._put(frame, addr)
        self.loop.call_soon(self._device.rest)

    def _put(self, frame: bytes, addr: Any) -> None:
        transport: Any = self.transport
        if transport is None or transport.is_closing():
            return
        if self._wire == "udp":
            transport.sendto(frame, addr)
        else:
            transport.write(frame)


class _Terminal(asyncio.Transport):
    """A pseudo-terminal as the device has it."""

    def __init__(self, connection: _Connection) -> None:
        super().__init__()
        line = PseudoTerminal(connection.data_received)
        self._line: PseudoTerminal | None = line
        self.path = line.path
        connection.connection_made(self)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send; where nobody reads the line is full, and a reply is lost as on a real one."""
        if self._line is not None:
            self._line.write(bytes(data))

    def is_closing(self) -> bool:
        """Return whether it is closed."""
        return self._line is None

    def close(self) -> None:
        """End the line."""
        line, self._line = self._line, None
        if line is not None:
            line.close()
