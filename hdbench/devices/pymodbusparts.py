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
