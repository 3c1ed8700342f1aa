"""A connection that carries one transaction at a time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from hdbench.devices.wire.address import Address
from hdbench.devices.wire.pdu import ReplyCheck

if TYPE_CHECKING:
    from hdbench.devices.wire.tcp import Certificates
    from hdbench.system.lines import Claim

Probe = Callable[[int], tuple[bytes, ReplyCheck]]
"""Gives the n-th who-are-you read: a request whose reply has a length of its own for this n.

A serial line has no transaction numbers. After a fault the link waits until the line is quiet,
throws away what came, and sends this read: a reply that is still on its way to an older request
has another length and does not pass.
"""


class Link(Protocol):
    """One request at a time, each with a deadline; opened when needed, closed after a fault.

    Attributes
    ----------
    where : str
        The address, for messages.
    opened : callable or None
        Called with the latest end on the clock, s, after every new connection and before anything
        else is sent on it; it may call `transact`.
    """

    where: str
    opened: Callable[[float], None] | None

    def transact(self, pdu: bytes, check: ReplyCheck, until_s: float) -> bytes:
        """Send one request once and return the PDU of its reply.

        Parameters
        ----------
        pdu : bytes
            Function code and data.
        check : callable
            Raises on a reply that the request does not allow; `StaleReply` drops it and waits on.
        until_s : float
            Latest end on the monotonic clock, s.

        Returns
        -------
        bytes
            Function code and data of the reply.

        Raises
        ------
        FrameError
            If no reply passed in time. A late one is never taken for the next.
        ExceptionReply
            If the device refused.
        """

    def close(self) -> None:
        """Close the connection; never raises. The next transaction opens it again."""


def connect(
    address: Address,
    *,
    unit: int = 1,
    probe: Probe | None = None,
    tls: Certificates | None = None,
    claim: Claim = "hold",
    clock: Callable[[], float] = time.monotonic,
) -> Link:
    """Return a link to the device at `address`; nothing is opened or sent yet.

    TCP, TLS and RTU need nothing but the standard library and pyserial; the others are pymodbus'.

    Parameters
    ----------
    address : Address
        As `parse_address` gives it.
    unit : int
        Modbus unit identifier.
    probe : callable, optional
        The who-are-you read of a serial line.
    tls : Certificates, optional
        Certificates for ``tls://``.
    claim : {"hold", "ask", "share"}, optional
        As `hdbench.system.lines.open_port` takes it.
    clock : callable, optional
        Monotonic clock, s.

    Returns
    -------
    Link

    Raises
    ------
    UsageError
        If certificates are missing, or cannot be used.
    """
    if address.scheme in ("udp", "rtu+tcp", "ascii"):
        from hdbench.devices.modbus.links import polled_link

        return polled_link(address, unit=unit, probe=probe, claim=claim, clock=clock)
    if address.scheme == "rtu":
        from hdbench.devices.wire.rtu import RtuLink

        return RtuLink(address, unit, probe, clock, claim)
    from hdbench.devices.wire.tcp import TcpLink

    if address.scheme == "tls":
        from hdbench.devices.wire.tcp import client_security

        return TcpLink(address, unit, clock, client_security(address, tls))
    return TcpLink(address, unit, clock)
