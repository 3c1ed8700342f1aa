"""All that hdbench takes from pymodbus, its internals too: what to look at when its version moves.

The strict client (`hdbench.devices.modbus.links`) and the emulators' server
(`hdbench.devices.emulator.server`) are subclasses of what stands here, and import it from here.
"""

from __future__ import annotations

import logging

import pymodbus
from pymodbus.client.base import ModbusBaseSyncClient
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerAscii, FramerBase, FramerRTU, FramerSocket, FramerType
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.server.base import ModbusBaseServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice
from pymodbus.transaction import TransactionManager
from pymodbus.transport import CommParams, CommType, ModbusProtocol

from hdbench.errors import UsageError

__all__ = [
    "INTERNALS",
    "VERSION",
    "CommParams",
    "CommType",
    "DataType",
    "DecodePDU",
    "FramerAscii",
    "FramerBase",
    "FramerRTU",
    "FramerSocket",
    "FramerType",
    "ModbusBaseServer",
    "ModbusBaseSyncClient",
    "ModbusException",
    "ModbusPDU",
    "ModbusProtocol",
    "ServerRequestHandler",
    "SimData",
    "SimDevice",
    "TransactionManager",
    "check_version",
]

VERSION = "3.16"
"""The series that was tried; the strictness of the client rests on its internals."""

INTERNALS = (
    ("DecodePDU", "decode", "self, frame", "checks a reply before it is decoded"),
    ("DecodePDU", "lookupPduClass", "self, data", "tells the length of an RTU frame"),
    ("ModbusPDU", "calculateRtuFrameSize", "data", "tells the length of an RTU frame"),
    ("FramerBase", "decode", "self, _data", "finds the end of a frame"),
    ("FramerBase", "encode", "self, payload, _dev_id, _tid", "frames a reply"),
    ("FramerBase", "buildFrame", "self, message", "frames a request"),
    ("FramerBase", "handleFrame", "self, data, exp_devid, exp_tid", "skips replies to others"),
    ("FramerRTU", "check_CRC", "data, check", "checks an RTU reply"),
    (
        "ModbusBaseSyncClient",
        "__init__",
        "self, framer, retries, comm_params, trace_packet, trace_pdu, trace_connect",
        "makes the client whose framer is replaced",
    ),
    ("ModbusBaseSyncClient", "execute", "self, no_response_expected, request", "one transaction"),
    ("ModbusBaseSyncClient", "send", "self, request, addr", "hands a frame to the line"),
    ("ModbusBaseSyncClient", "recv", "self, size", "asks the line for what came"),
    ("TransactionManager", "sync_get_response", "self, dev_id, tid", "hands it to the framer"),
    ("ModbusProtocol", "close", "self, reconnect", "ends every connection of a server"),
    ("ModbusProtocol", "datagram_received", "self, data, addr", "takes what a host sends"),
    (
        "ServerRequestHandler",
        "__init__",
        "self, owner, trace_packet, trace_pdu, trace_connect",
        "makes the connection of one host",
    ),
    ("ServerRequestHandler", "callback_data", "self, data, addr", "answers one host"),
    ("ServerRequestHandler", "callback_disconnected", "self, exc", "tells that a host is gone"),
    ("ModbusBaseServer", "callback_new_connection", "self", "makes the connection of one host"),
)
"""Methods that are overridden or called: class, name, parameters, and what for."""

# without a handler of its own a library's warnings reach the user's screen
logging.getLogger("pymodbus").addHandler(logging.NullHandler())


def check_version(found: str = pymodbus.__version__) -> None:
    """Refuse another version than the one whose internals are known."""
    if not found.startswith(f"{VERSION}."):
        raise UsageError(
            f"pymodbus {found} is installed; needed: {VERSION}, whose internals are known",
            where="Modbus",
            fix=f"pip install 'pymodbus=={VERSION}.*'",
        )


check_version()
