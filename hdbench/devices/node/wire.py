"""Wire of a node: registers by name, nothing wrong passes, no call outlives its deadline.

Every reply is compared byte for byte with what the request allows, the deadline is kept on the
monotonic clock, and after any fault the link makes sure that no late reply is taken for a later
one. What decides - blocks and status - carries a number of the request besides.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Sequence
from typing import NoReturn

from hdbench.devices.node.blocks import BlockExchange
from hdbench.devices.node.registers import (
    BLOCK,
    IDENTITY,
    NONCE,
    STATUS,
    Refusal,
    Register,
    register,
    register_at,
)
from hdbench.devices.transactor import TWICE, Build, Transactor
from hdbench.devices.wire import (
    ExceptionReply,
    FrameError,
    Link,
    ReplyCheck,
    StaleReply,
    exchange_registers,
    read_registers,
    registers_check,
    write_register,
    write_registers,
)
from hdbench.errors import BusyError, DeviceError, HdbenchError

# lengths that no other read of a node has, in registers
_PROBE_COUNTS = (3, 5, 7, 9, 11, 13, 17, 19)


def node_probe(number: int) -> tuple[bytes, ReplyCheck]:
    """Return the n-th who-are-you read of a node, a `hdbench.devices.wire.Probe`."""
    count = _PROBE_COUNTS[number % len(_PROBE_COUNTS)]
    return read_registers(IDENTITY[0].address, count)


def span(group: Sequence[Register]) -> tuple[int, int]:
    """Return address and number of adjacent registers."""
    return group[0].address, sum(entry.size for entry in group)


def writable(group: Sequence[Register], values: bytes) -> tuple[int, int]:
    """Return address and number of a write; only registers that the map calls writable pass."""
    closed = [entry.name for entry in group if entry.access != "rw"]
    address, count = span(group)
    if closed or len(values) != 2 * count:
        raise ValueError(f"{len(values)} bytes for {count} registers; not writable: {closed}")
    return address, count


class NodeWire(Transactor):
    """Register access to one node.

    Parameters
    ----------
    link : Link
        The connection; owned by the wire from now on.
    deadline_s : float
        Longest time one call may take, s, above 0; repetitions included.
    clock : callable, optional
        Monotonic clock, s.

    Notes
    -----
    Reads and the acknowledged block exchange are repeated once within the deadline. Writes are
    sent exactly once: what became of a write without an answer has to be read back.
    """

    def __init__(
        self, link: Link, *, deadline_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(link, deadline_s=deadline_s, clock=clock)
        self.where = f"node {link.where}"
        self._session = 0
        self._heartbeat = 0
        self._nonce = 0
        link.opened = self._present_session

    def read(self, group: Sequence[Register]) -> bytes:
        """Return the bytes of adjacent registers."""
        address, count = span(group)
        return self._repeat(lambda: read_registers(address, count), group[0])

    def read_status(self) -> bytes:
        """Return the status block of this moment, tagged so that it can be no older one."""
        address, count = span(STATUS)

        def build() -> tuple[bytes, ReplyCheck]:
            self._nonce = self._nonce % 0xFFFF + 1
            nonce = struct.pack(">H", self._nonce)
            pdu, exact = exchange_registers(address, count, NONCE[0].address, nonce)

            def check(reply: bytes) -> None:
                exact(reply)
                if reply[-2:] != nonce:
                    raise StaleReply

            return pdu, check

        return self._repeat(build, STATUS[0])

    def exchange(self, window: BlockExchange, ack: int) -> bytes:
        """Acknowledge a block, feed the watchdog and read the window, in one transaction."""

        def build() -> tuple[bytes, ReplyCheck]:
            self._heartbeat = self._heartbeat % 0xFFFF + 1
            return window.build(ack, self._heartbeat)

        return self._repeat(build, BLOCK[0])

    def feed(self) -> None:
        """Write a changed heartbeat, outside of the block exchange."""
        self._heartbeat = self._heartbeat % 0xFFFF + 1
        self.write_once((register("heartbeat"),), struct.pack(">H", self._heartbeat))

    def write_once(self, group: Sequence[Register], values: bytes) -> None:
        """Write `values` to adjacent registers, sent exactly once."""
        address, count = writable(group, values)
        request = (
            write_register(address, int.from_bytes(values, "big"))
            if count == 1
            else write_registers(address, values)
        )
        self._transact(lambda: request, group[0], 1)

    def take_session(self, token: int) -> None:
        """Write the session's token; it is shown again on every later connection."""
        self._session = 0
        self.write_once((register("session"),), struct.pack(">I", token))
        self._session = token

    def close(self) -> None:
        """Give the session back and close the connection; never raises."""
        if self._session:
            try:
                self.take_session(0)
            except HdbenchError:
                # the node ends the session by itself once the connection is gone
                self._link.close()
        self._link.close()

    def _present_session(self, until_s: float) -> None:
        """Show the token on a fresh connection."""
        if not self._session:
            return
        address = register("session").address
        pdu, check = write_registers(address, struct.pack(">I", self._session))
        try:
            self._link.transact(pdu, check, until_s)
        except ExceptionReply:
            # the session is lost; without it a new connection may still read, and stop the motor
            self._session = 0
            self._link.close()
            raise

    def _repeat(self, build: Build, first: Register) -> bytes:
        return self._transact(build, first, TWICE)[2:]

    def _transact(self, build: Build, first: Register, attempts: int) -> bytes:
        return self.transact(
            build,
            attempts,
            refused=lambda reply, until_s: self._refused(reply, first, until_s),
            fault=lambda what: self._fault(first, what),
        )

    def _refused(self, reply: ExceptionReply, first: Register, until_s: float) -> NoReturn:
        """Raise what the node's exception means, with its own reason where it gives one."""
        reason, address = self._reason(until_s)
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

    def _reason(self, until_s: float) -> tuple[Refusal, int]:
        """Ask, once and in what is left of the deadline, why the last request was refused."""
        pdu, _ = read_registers(register("refusal").address, 2)
        try:
            reply = self._link.transact(pdu, registers_check(3, 2), until_s)
            code, where = struct.unpack(">HH", reply[2:])
            return Refusal(code), where
        except (ExceptionReply, FrameError, ValueError):
            return Refusal.NONE, 0

    def _fault(self, first: Register, what: str) -> DeviceError:
        fix = "check address, power and cable of the node, then run `hdbench doctor`"
        if "Permission denied" in what:
            fix = (
                "join the group that owns the port (often: sudo usermod -aG dialout $USER), log in"
            )
            fix += " again"
        elif "No such file" in what:
            fix = "take a port that `hdbench devices` lists, and check the cable"
        elif "another program" in what:
            fix = "close the other program that has the port open, then run again"
        return DeviceError(what, where=self._place(first), fix=fix)

    def _place(self, entry: Register) -> str:
        return f"{self.where}, register {entry.name} (0x{entry.address:04X})"
