"""All that hdbench takes from pymodbus, its internals too: what to look at when its version moves.

The strict client (`hdbench.devices.modbus.replies`) and the emulators' server
(`hdbench.devices.emulator.server`) are subclasses of what stands here, and import it from here.
"""

from __future__ import annotations

import logging

import pymodbus
from pymodbus.client.base import ModbusBaseSyncClient as ModbusBaseSyncClient
from pymodbus.exceptions import ModbusException as ModbusException
from pymodbus.framer import FramerAscii as FramerAscii
from pymodbus.framer import FramerBase as FramerBase
from pymodbus.framer import FramerRTU as FramerRTU
from pymodbus.framer import FramerSocket as FramerSocket
from pymodbus.framer import FramerType as FramerType
from pymodbus.pdu import DecodePDU as DecodePDU
from pymodbus.pdu import ModbusPDU as ModbusPDU
from pymodbus.server.base import ModbusBaseServer as ModbusBaseServer
from pymodbus.server.requesthandler import ServerRequestHandler as ServerRequestHandler
from pymodbus.simulator import DataType as DataType
from pymodbus.simulator import SimData as SimData
from pymodbus.simulator import SimDevice as SimDevice
from pymodbus.transaction import TransactionManager as TransactionManager
from pymodbus.transport import CommParams as CommParams
from pymodbus.transport import CommType as CommType
from pymodbus.transport import ModbusProtocol as ModbusProtocol

from hdbench.errors import UsageError

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
