"""The client against a server of another making: pymodbus, on TCP and on a serial line."""

import asyncio
import os
import struct
import sys
import threading
import time
import tty
from contextlib import contextmanager

import pytest
from faults.lines import in_thread
from pymodbus.framer import FramerType
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from hdbench.devices.wire import (
    ExceptionReply,
    connect,
    exchange_registers,
    parse_address,
    read_bits,
    read_registers,
    write_bit,
    write_register,
    write_registers,
)

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")

VALUES = [1000 + k for k in range(130)]


def _device():
    bits = [SimData(0, values=[k % 3 == 0 for k in range(32)], datatype=DataType.BITS)]
    holding = [SimData(0, values=VALUES, datatype=DataType.REGISTERS)]
    inputs = [SimData(0, values=[7, 8, 9], datatype=DataType.REGISTERS)]
    return SimDevice(1, simdata=(bits, bits, holding, inputs))


@contextmanager
def _server(wire):
    """Serve the device; yields a link to it."""
    pump = None
    with in_thread(lambda: asyncio.sleep(0.0), lambda: None) as (loop, _):

        async def start(address):
            if wire == "tcp":
                made = ModbusTcpServer(_device(), address=("127.0.0.1", 0))
            else:
                made = ModbusSerialServer(
                    _device(), framer=FramerType.RTU, port=address, baudrate=115200
                )
            await made.serve_forever(background=True)
            return made

        if wire == "tcp":
            server = asyncio.run_coroutine_threadsafe(start(None), loop).result(5)
            port = server.transport.sockets[0].getsockname()[1]
            link = connect(parse_address(f"tcp://127.0.0.1:{port}"))
        else:
            pump = _Cable()
            server = asyncio.run_coroutine_threadsafe(start(pump.ends[1]), loop).result(5)
            link = connect(parse_address(f"rtu://{pump.ends[0]}"))
        try:
            yield link
        finally:
            link.close()
            asyncio.run_coroutine_threadsafe(server.shutdown(), loop).result(5)
            if pump is not None:
                pump.close()


class _Cable:
    """Two pseudo-terminals joined by a thread."""

    def __init__(self):
        pairs = [os.openpty() for _ in range(2)]
        for _, slave in pairs:
            tty.setraw(slave)
        self.ends = [os.ttyname(slave) for _, slave in pairs]
        self._descriptors = [descriptor for pair in pairs for descriptor in pair]
        self._ended = threading.Event()
        (one, _), (other, _) = pairs
        self._threads = [
            threading.Thread(target=self._copy, args=ends, daemon=True)
            for ends in ((one, other), (other, one))
        ]
        for thread in self._threads:
            thread.start()

    def _copy(self, source, target):
        import select

        while not self._ended.is_set():
            if select.select([source], [], [], 0.05)[0]:
                os.write(target, os.read(source, 512))

    def close(self):
        self._ended.set()
        for thread in self._threads:
            thread.join(5)
        for descriptor in self._descriptors:
            os.close(descriptor)


def ask(link, request):
    pdu, check = request
    return link.transact(pdu, check, time.monotonic() + 2.0)


def words(reply):
    return list(struct.unpack(f">{reply[1] // 2}H", reply[2:]))


@pytest.mark.parametrize("wire", ["tcp", "rtu"])
def test_every_request_is_understood_by_another_server(wire):
    with _server(wire) as link:
        assert words(ask(link, read_registers(3, 2))) == VALUES[3:5]
        assert words(ask(link, read_registers(0, 125))) == VALUES[:125]
        assert words(ask(link, read_registers(0, 3, function=4))) == [7, 8, 9]
        ask(link, write_register(5, 4711))
        ask(link, write_registers(6, struct.pack(">HH", 1, 65535)))
        assert words(ask(link, read_registers(5, 3))) == [4711, 1, 65535]
        written = struct.pack(">H", 77)
        assert words(ask(link, exchange_registers(5, 2, 6, written))) == [4711, 77]
        bits = ask(link, read_bits(0, 10))
        assert bits[2:] == bytes((0b01001001, 0b10))
        assert ask(link, read_bits(0, 10, function=2))[2:] == bits[2:]
        ask(link, write_bit(1, on=True))
        assert ask(link, read_bits(0, 3))[2] == 0b011


@pytest.mark.parametrize("wire", ["tcp", "rtu"])
def test_a_refusal_of_another_server_is_an_exception_reply(wire):
    with _server(wire) as link:
        with pytest.raises(ExceptionReply) as caught:
            ask(link, read_registers(1000, 2))
        assert caught.value.code == 2
        # the link goes on without a fault
        assert words(ask(link, read_registers(3, 1))) == [VALUES[3]]
