"""Requests as bytes, each with the check of its reply, and a link that carries one at a time."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from hdbench.devices.wire.address import Address

if TYPE_CHECKING:
    from hdbench.profile.acquiring import TlsFiles
    from hdbench.system.lines import Claim

EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledged, still working",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target does not respond",
}
ReplyCheck = Callable[[bytes], None]
"""Raises on a reply (function code and data) that the request does not allow."""
_MAX_READ = 125
_MAX_WRITE = 123
_MAX_EXCHANGE_WRITE = 121
_MAX_BITS = 2000


class FrameError(Exception):
    """A reply that must not be delivered, or none at all."""


class StaleReply(Exception):  # noqa: N818 - a good reply, but to another request
    """A reply that belongs to an earlier request: it is dropped, and the wait goes on."""


class ExceptionReply(Exception):  # noqa: N818 - a well-formed answer, not a fault of the wire
    """The device refused the request.

    Parameters
    ----------
    code : int
        Modbus exception code.
    """

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code} ({EXCEPTIONS.get(code, 'unknown')})")
        self.code = code


@dataclass(frozen=True, slots=True)
class ReplyForm:
    """The reply that a request allows: how it begins, how long it is.

    Parameters
    ----------
    head : bytes
        How it begins, function code first.
    size : int
        Its length, bytes.
    spare_bits : int
        Bits of the last byte, from the left, that must be zero.
    """

    head: bytes
    size: int
    spare_bits: int = 0

    def __call__(self, pdu: bytes) -> None:
        """Raise `FrameError` on any other reply, `ExceptionReply` on a refusal."""
        if len(pdu) != self.size or not pdu.startswith(self.head):
            function = self.head[0]
            if len(pdu) == 2 and pdu[0] == function | 0x80:
                raise ExceptionReply(pdu[1])
            if not pdu or pdu[0] != function:
                found = pdu[0] if pdu else "missing"
                raise FrameError(f"function code {found}; needed: {function}")
            raise FrameError(
                f"a reply of {len(pdu)} bytes, {pdu[:8].hex(' ')}; needed: {self.size} bytes, "
                f"{self.head.hex(' ')} first"
            )
        if self.spare_bits and pdu[-1] >> (8 - self.spare_bits):
            raise FrameError("bits beyond those asked for are not zero")


Request = tuple[bytes, ReplyForm]
"""Function code and data, and the form of the reply."""


def registers_check(function: int, count: int) -> ReplyForm:
    """Return the form of a reply with exactly `count` registers, 1 to 125 (functions 3, 4, 23)."""
    return ReplyForm(bytes((function, 2 * count)), 2 + 2 * count)


def read_registers(address: int, count: int, *, function: int = 3) -> Request:
    """Return a read of holding (function 3) or input registers (function 4), 1 to 125."""
    _bound("count", count, _MAX_READ)
    return struct.pack(">BHH", function, address, count), registers_check(function, count)


def read_bits(address: int, count: int, *, function: int = 1) -> Request:
    """Return a read of coils (function 1) or discrete inputs (function 2), 1 to 2000."""
    _bound("count", count, _MAX_BITS)
    n_bytes = (count + 7) // 8
    form = ReplyForm(bytes((function, n_bytes)), 2 + n_bytes, spare_bits=-count % 8)
    return struct.pack(">BHH", function, address, count), form


def write_register(address: int, value: int) -> Request:
    """Return a write of one register, 0 to 65535 (function 6)."""
    return _echoed(struct.pack(">BHH", 6, address, value))


def write_bit(address: int, *, on: bool) -> Request:
    """Return a write of one coil (function 5)."""
    return _echoed(struct.pack(">BHH", 5, address, 0xFF00 if on else 0))


def write_registers(address: int, values: bytes) -> Request:
    """Return a write of 1 to 123 registers, two bytes each (function 16)."""
    count = len(values) // 2
    _bound("registers", count, _MAX_WRITE)
    return _echoed(struct.pack(">BHHB", 16, address, count, len(values)) + values)


def exchange_registers(address: int, count: int, target: int, values: bytes) -> Request:
    """Return a write of `values` at `target`, then a read of `count` registers (function 23).

    1 to 125 registers are read, 1 to 121 written.
    """
    _bound("count", count, _MAX_READ)
    n_written = len(values) // 2
    _bound("registers", n_written, _MAX_EXCHANGE_WRITE)
    head = struct.pack(">BHHHHB", 23, address, count, target, n_written, len(values))
    return head + values, registers_check(23, count)


def _echoed(pdu: bytes) -> Request:
    """Return a write, whose reply repeats address and value, or address and number of registers."""
    return pdu, ReplyForm(pdu[:5], 5)


def _bound(name: str, value: int, high: int) -> None:
    if not 1 <= value <= high:
        raise ValueError(f"{name} {value}; needed: 1 to {high}")


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


def greet(link: Link, until_s: float) -> None:
    """Call what is to come first on a fresh connection; one that did not begin well is closed."""
    if link.opened is not None:
        try:
            link.opened(until_s)
        except Exception:
            link.close()
            raise


def connect(
    address: Address,
    *,
    unit: int = 1,
    probe: Probe | None = None,
    tls: TlsFiles | None = None,
    claim: Claim = "hold",
) -> Link:
    """Return a link to the device at `address`; nothing is opened or sent yet.

    TCP, TLS and RTU need nothing but the standard library and pyserial; the others are pymodbus'.
    """
    if address.scheme in ("udp", "rtu+tcp", "ascii"):
        from hdbench.devices.modbus.replies import polled_link

        return polled_link(address, unit=unit, probe=probe, claim=claim)
    if address.scheme == "rtu":
        from hdbench.devices.wire.rtu import RtuLink

        return RtuLink(address, unit, probe, claim)
    from hdbench.devices.wire.tcp import TcpLink, security_of

    return TcpLink(address, unit, security_of(address, tls))
