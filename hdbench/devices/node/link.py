"""One transaction on the wire: pymodbus' client, every reply checked, every wait bounded."""

from __future__ import annotations

import logging
import socket
import struct
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from hdbench.devices.node.frames import (
    ExceptionReply,
    FrameError,
    ReplyCheck,
    echo_check,
    find_reply,
    registers_check,
)
from hdbench.devices.node.registers import register

if TYPE_CHECKING:
    from pymodbus.client import ModbusTcpClient
    from pymodbus.pdu import ModbusPDU

__all__ = ["NodeLink"]


class NodeLink:
    """A connection to one node that is opened when needed and closed after any fault.

    Parameters
    ----------
    host : str
        Host name or address.
    port : int
        TCP port.
    unit : int
        Modbus unit identifier.
    clock : callable, optional
        Monotonic clock, s.

    Attributes
    ----------
    session : int
        Token shown on every new connection before anything else; 0: none.
    """

    def __init__(
        self, host: str, port: int, unit: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.session = 0
        self.unit = unit
        self._address = (host, port)
        self._clock = clock
        self._client: ModbusTcpClient | None = None
        self._until_s = 0.0
        self._tid = 0
        self._check: ReplyCheck = registers_check(3, 0)
        self._reply: bytes | None = None

    def transact(self, request: ModbusPDU, check: ReplyCheck, until_s: float) -> bytes:
        """Send one request once and return the PDU of its reply.

        Parameters
        ----------
        request : ModbusPDU
            What is sent.
        check : ReplyCheck
            Raises on a reply that the request does not allow.
        until_s : float
            Latest end on the clock, s.

        Returns
        -------
        bytes
            Function code and data.

        Raises
        ------
        FrameError
            If no reply passed in time; the connection is closed then.
        ExceptionReply
            If the node refused.
        """
        from pymodbus.exceptions import ModbusException

        try:
            client = self._connected(until_s)
            self._until_s, self._check, self._reply = until_s, check, None
            client.comm_params.timeout_connect = self._left_s()
            client.execute(False, request)
            return self._checked_reply()
        except FrameError:
            self.close()
            raise
        except (ModbusException, OSError, ValueError, IndexError, struct.error) as error:
            # the last three: what pymodbus' decoders let through on malformed frames
            self.close()
            raise FrameError(self._describe(error)) from error

    def close(self) -> None:
        """Close the connection; never raises."""
        client, self._client = self._client, None
        if client is not None:
            client.close()  # type: ignore[no-untyped-call]

    def _checked_reply(self) -> bytes:
        if self._reply is None:
            raise FrameError("the reply does not belong to the request")
        return self._reply

    def _describe(self, error: BaseException) -> str:
        if not self._left_s() > 0.0:
            return "no valid reply in time"
        if isinstance(error, ConnectionResetError):
            return "the node reset the connection"
        if isinstance(error, OSError):
            return f"no connection ({error.strerror or error})"
        return "the node closed the connection or sent no valid reply"

    def _left_s(self) -> float:
        return max(0.0, self._until_s - self._clock())

    def _connected(self, until_s: float) -> ModbusTcpClient:
        if self._client is not None:
            return self._client
        from pymodbus.client import ModbusTcpClient

        _silence("pymodbus")
        self._until_s = until_s
        if not self._left_s() > 0.0:
            raise FrameError("no time left to connect")
        connection = socket.create_connection(self._address, timeout=self._left_s())
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = ModbusTcpClient(
            self._address[0],
            port=self._address[1],
            timeout=self._left_s(),
            retries=0,
            trace_packet=self._inspect,
        )
        client.socket = connection
        # transaction numbers go on across connections: a stale reply never matches
        client.transaction.next_tid = self._tid
        self._client = client
        if self.session:
            self._present_session(until_s)
        return client

    def _present_session(self, until_s: float) -> None:
        from pymodbus.pdu.register_message import WriteMultipleRegistersRequest

        address = register("session").address
        request = WriteMultipleRegistersRequest(
            address=address,
            count=2,
            registers=list(struct.unpack(">HH", struct.pack(">I", self.session))),
            dev_id=self.unit,
        )
        try:
            self.transact(request, echo_check(16, address, 2), until_s)
        except ExceptionReply:
            # the session is lost; without it a new connection may still read, and stop the motor
            self.session = 0
            self.close()
            raise

    def _inspect(self, sending: bool, data: bytes) -> bytes:
        """Watch the bytes of pymodbus: note the request's number, check the reply, keep time."""
        if sending:
            self._tid = int.from_bytes(data[:2], "big")
            return data
        reply = find_reply(data, self._tid, self.unit)
        if reply is not None:
            self._check(reply)
            self._reply = reply
        if self._client is not None:
            self._client.comm_params.timeout_connect = self._left_s()
        return data


def _silence(name: str) -> None:
    """Keep a library's own log off stderr unless somebody has set it up."""
    logger = logging.getLogger(name)
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())
