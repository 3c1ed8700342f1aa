"""One strict layer around the pymodbus client: nothing wrong passes, no call outlives its deadline.

pymodbus accepts replies with a wrong function code, byte count or echo, and hides repetitions.
Here every reply is compared byte for byte with what the request allows *before* pymodbus decodes
it, the deadline is kept on the monotonic clock, and after any fault the connection is closed, so
that no late reply can ever be taken for a later one.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NoReturn

from hdbench.devices.node.frames import (
    ExceptionReply,
    FrameError,
    ReplyCheck,
    echo_check,
    registers_check,
)
from hdbench.devices.node.link import NodeLink
from hdbench.devices.node.registers import Refusal, Register, register, register_at
from hdbench.errors import BusyError, DeviceError, HdbenchError

if TYPE_CHECKING:
    from pymodbus.pdu import ModbusPDU

__all__ = ["NodeWire"]

# a lost request or reply is repeated once, each try within half of the deadline
_ATTEMPTS = 2


class NodeWire:
    """Register access to one node over Modbus TCP.

    Parameters
    ----------
    host : str
        Host name or address.
    port : int
        TCP port.
    deadline_s : float
        Longest time one call may take, s, above 0; repetitions included.
    unit : int
        Modbus unit identifier.
    clock : callable, optional
        Monotonic clock, s.

    Notes
    -----
    Reads and the acknowledged block exchange are repeated once within the deadline. Writes are
    sent exactly once: what became of a write without an answer has to be read back.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        deadline_s: float,
        unit: int = 1,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.where = f"node {host}:{port}"
        self.repeats = 0
        self._link = NodeLink(host, port, unit, clock)
        self._deadline_s = deadline_s
        self._clock = clock

    def read(self, group: Sequence[Register]) -> bytes:
        """Return the bytes of adjacent registers.

        Raises
        ------
        DeviceError
            If no valid answer came within the deadline or the node refused.
        """
        from pymodbus.pdu.register_message import ReadHoldingRegistersRequest

        address, count = _span(group)

        def request() -> ModbusPDU:
            return ReadHoldingRegistersRequest(address=address, count=count, dev_id=self._link.unit)

        return self._repeat(request, registers_check(3, count), group[0])[2:]

    def exchange(self, group: Sequence[Register], feed: Sequence[Register], values: bytes) -> bytes:
        """Write `values` to `feed`, then read `group`, in one transaction that may be repeated.

        Raises
        ------
        DeviceError
            As for `read`.
        """
        from pymodbus.pdu.register_message import ReadWriteMultipleRegistersRequest

        address, count = _span(group)
        target, _ = _writable(feed, values)
        words = _words(values)

        def request() -> ModbusPDU:
            return ReadWriteMultipleRegistersRequest(
                read_address=address,
                read_count=count,
                write_address=target,
                write_registers=words,
                dev_id=self._link.unit,
            )

        return self._repeat(request, registers_check(23, count), group[0])[2:]

    def write_once(self, group: Sequence[Register], values: bytes) -> None:
        """Write `values` to adjacent registers, sent exactly once.

        Raises
        ------
        DeviceError
            If no valid answer came within the deadline (the write may or may not have happened; the
            error's cause is a `FrameError` then) or the node refused.
        BusyError
            If another host holds the node.
        """
        from pymodbus.pdu.register_message import (
            WriteMultipleRegistersRequest,
            WriteSingleRegisterRequest,
        )

        address, count = _writable(group, values)
        words = _words(values)
        unit = self._link.unit
        if count == 1:
            check = echo_check(6, address, words[0])
            request: ModbusPDU = WriteSingleRegisterRequest(
                address=address, registers=words, dev_id=unit
            )
        else:
            check = echo_check(16, address, count)
            request = WriteMultipleRegistersRequest(
                address=address, count=count, registers=words, dev_id=unit
            )
        try:
            self._link.transact(request, check, self._clock() + self._deadline_s)
        except ExceptionReply as reply:
            self._refused(reply, group[0])
        except FrameError as fault:
            raise self._fault(group[0], str(fault)) from fault

    def take_session(self, token: int) -> None:
        """Write the session's token; it is shown again on every later connection.

        Raises
        ------
        BusyError
            If another host holds the node.
        DeviceError
            As for `write_once`.
        """
        self._link.session = 0
        self.write_once((register("session"),), struct.pack(">I", token))
        self._link.session = token

    def close(self) -> None:
        """Give the session back and close the connection; never raises."""
        if self._link.session:
            try:
                self.take_session(0)
            except HdbenchError:
                # the node ends the session by itself once the connection is gone
                self._link.close()
        self._link.close()

    def _repeat(self, build: Callable[[], ModbusPDU], check: ReplyCheck, first: Register) -> bytes:
        start_s = self._clock()
        for attempt in range(1, _ATTEMPTS + 1):
            until_s = start_s + self._deadline_s * attempt / _ATTEMPTS
            try:
                return self._link.transact(build(), check, until_s)
            except ExceptionReply as reply:
                self._refused(reply, first)
            except FrameError as fault:
                self.repeats += 1
                last = fault
        raise self._fault(first, f"{last}, {_ATTEMPTS} times") from last

    def _refused(self, reply: ExceptionReply, first: Register) -> NoReturn:
        """Raise what the node's exception means, with its own reason where it gives one."""
        reason, address = self._reason()
        entry = (register_at(address) or first) if reason else first
        why = f": {reason.name.lower().replace('_', ' ')}" if reason else ""
        kind: type[HdbenchError] = DeviceError
        fix = "compare the value with the node's limits (docs/node-protocol.md)"
        if reason == Refusal.SESSION_HELD:
            kind = BusyError
            fix = "wait until the other host has finished; a killed one loses its session in 2 s"
        raise kind(
            f"the node refused with {reply}{why}", where=self._place(entry), fix=fix
        ) from reply

    def _reason(self) -> tuple[Refusal, int]:
        """Ask, once and without further consequence, why the last request was refused."""
        from pymodbus.pdu.register_message import ReadHoldingRegistersRequest

        address = register("refusal").address
        request = ReadHoldingRegistersRequest(address=address, count=2, dev_id=self._link.unit)
        until_s = self._clock() + self._deadline_s / _ATTEMPTS
        try:
            pdu = self._link.transact(request, registers_check(3, 2), until_s)
            code, where = struct.unpack(">HH", pdu[2:])
            return Refusal(code), where
        except (ExceptionReply, FrameError, ValueError):
            return Refusal.NONE, 0

    def _fault(self, first: Register, what: str) -> DeviceError:
        return DeviceError(
            f"{what} (deadline {self._deadline_s:g} s)",
            where=self._place(first),
            fix="check power and network of the node, then run `hdbench doctor`",
        )

    def _place(self, entry: Register) -> str:
        return f"{self.where}, register {entry.name} (0x{entry.address:04X})"


def _words(values: bytes) -> list[int]:
    return list(struct.unpack(f">{len(values) // 2}H", values))


def _span(group: Sequence[Register]) -> tuple[int, int]:
    return group[0].address, sum(entry.size for entry in group)


def _writable(group: Sequence[Register], values: bytes) -> tuple[int, int]:
    """Return address and count of a write; only registers that the map calls writable pass."""
    closed = [entry.name for entry in group if entry.access != "rw"]
    address, count = _span(group)
    if closed or len(values) != 2 * count:
        raise ValueError(f"{len(values)} bytes for {count} registers; not writable: {closed}")
    return address, count
