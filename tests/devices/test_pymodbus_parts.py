"""Parts of pymodbus that hdbench uses are those that were tried."""

import inspect
import re
import tomllib
from pathlib import Path

import pymodbus
import pytest

from hdbench.devices import pymodbusparts
from hdbench.errors import UsageError

# methods that are overridden or called, and what for
INTERNALS = """
DecodePDU.lookupPduClass(self, data): tells the length of an RTU frame
ModbusPDU.calculateRtuFrameSize(data): tells the length of an RTU frame
FramerBase.decode(self, _data): finds the end of a frame
FramerBase.encode(self, payload, _dev_id, _tid): frames a reply
FramerBase.buildFrame(self, message): frames a request
FramerBase.handleFrame(self, data, exp_devid, exp_tid): lets a reply through
FramerRTU.check_CRC(data, check): checks an RTU reply
ModbusBaseSyncClient.__init__(self, framer, retries, comm_params, trace_packet, trace_pdu, \
trace_connect): makes the client whose framer is replaced
ModbusBaseSyncClient.send(self, request, addr): hands a frame to the line
ModbusBaseSyncClient.recv(self, size): asks the line for what came
TransactionManager.getNextTID(self): numbers the requests
TransactionManager.pdu_send(self, pdu, addr): hands a request to framer and line
TransactionManager.sync_get_response(self, dev_id, tid): hands it to the framer
ModbusProtocol.close(self, reconnect): ends every connection of a server
ModbusProtocol.datagram_received(self, data, addr): takes what a host sends
ServerRequestHandler.__init__(self, owner, trace_packet, trace_pdu, trace_connect): \
makes the connection of one host
ServerRequestHandler.callback_data(self, data, addr): answers one host
ServerRequestHandler.callback_disconnected(self, exc): tells that a host is gone
ModbusBaseServer.callback_new_connection(self): makes the connection of one host
"""


@pytest.mark.parametrize(
    "line", INTERNALS.split("\n")[1:-1], ids=lambda line: line.partition("(")[0]
)
def test_an_internal_of_pymodbus_is_still_there(line):
    owner, name, parameters, use = re.fullmatch(r"(\w+)\.(\w+)\((.*)\): (.*)", line).groups()
    found = getattr(getattr(pymodbusparts, owner), name, None)
    now = "gone" if found is None else ", ".join(inspect.signature(found).parameters)
    assert now == parameters, (
        f"pymodbus {pymodbus.__version__} changed {owner}.{name} ({use}): it takes ({now}); "
        f"hdbench relies on ({parameters}). Compare its source, run tools/faults/polled.py, then "
        "change hdbench/devices/pymodbusparts.py and the pin in pyproject.toml together"
    )


def test_the_pin_of_the_package_is_the_version_of_the_code():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
    major, minor = pymodbusparts.VERSION.split(".")
    pin = f"pymodbus>={major}.{minor},<{major}.{int(minor) + 1}"
    assert pin in project["project"]["dependencies"]


def test_another_version_is_refused_with_what_to_install():
    pymodbusparts.check_version(f"{pymodbusparts.VERSION}.7")
    for other in ("3.17.0", "3.15.4", "4.0.0"):
        words = f"pymodbus {other} is installed; needed: 3.16"
        with pytest.raises(UsageError, match=words) as told:
            pymodbusparts.check_version(other)
        assert told.value.fix == "pip install 'pymodbus==3.16.*'"
