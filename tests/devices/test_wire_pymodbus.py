"""The client against a server of another making: pymodbus, its own store behind its own server."""

import asyncio
import struct
import time
from contextlib import closing, contextmanager

import pytest
from faults.lines import in_thread
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from hdbench.devices.wire.address import parse_address
from hdbench.devices.wire.link import (
    ExceptionReply,
    connect,
    exchange_registers,
    read_bits,
    read_registers,
    write_bit,
    write_register,
    write_registers,
)

VALUES = [1000 + k for k in range(130)]


def _device():
    bits = [SimData(0, values=[k % 3 == 0 for k in range(32)], datatype=DataType.BITS)]
    holding = [SimData(0, values=VALUES, datatype=DataType.REGISTERS)]
    inputs = [SimData(0, values=[7, 8, 9], datatype=DataType.REGISTERS)]
    return SimDevice(1, simdata=(bits, bits, holding, inputs))


@contextmanager
def _server():
    """Serve the device; yields a link to it."""
    with in_thread(lambda: asyncio.sleep(0.0), lambda: None) as (loop, _):

        async def start():
            made = ModbusTcpServer(_device(), address=("127.0.0.1", 0))
            await made.serve_forever(background=True)
            return made

        server = asyncio.run_coroutine_threadsafe(start(), loop).result(5)
        port = server.transport.sockets[0].getsockname()[1]
        with closing(connect(parse_address(f"tcp://127.0.0.1:{port}"))) as link:
            yield link
        asyncio.run_coroutine_threadsafe(server.shutdown(), loop).result(5)


def ask(link, request):
    pdu, check = request
    return link.transact(pdu, check, time.monotonic() + 2.0)


def words(reply):
    return list(struct.unpack(f">{reply[1] // 2}H", reply[2:]))


def test_every_request_is_understood_by_another_server():
    with _server() as link:
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


def test_a_refusal_of_another_server_is_an_exception_reply():
    with _server() as link:
        with pytest.raises(ExceptionReply) as caught:
            ask(link, read_registers(1000, 2))
        assert caught.value.code == 2
        # the link goes on without a fault
        assert words(ask(link, read_registers(3, 1))) == [VALUES[3]]
