"""Node access: registers by name, identity, limits, and parameters that are read back."""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Mapping, Sequence

from hdbench.devices.bench import Identity
from hdbench.devices.daq import DaqSettings
from hdbench.devices.node import registers as reg
from hdbench.devices.node.blocks import BlockExchange, channel_bits
from hdbench.devices.registers import Register, Value, as_float32, decode_group, encode_group
from hdbench.devices.transactor import TWICE, Build, Transactor, same_reply, was_answered
from hdbench.devices.wire import link as wire
from hdbench.errors import BusyError, DeviceError, HdbenchError
from hdbench.profile.schema import ReferenceWave
from hdbench.profile.waves import ReferenceProgram

# what helps where a port cannot be opened
_FIXES = {
    "Permission denied": "join the group that owns the port (often: sudo usermod -aG dialout "
    "$USER), log in again",
    "No such file": "take a port that `hdbench devices` lists, and check the cable",
    "another program": "close the other program that has the port open, then run again",
}
# lengths that no other read of a node has, in registers
_PROBE_COUNTS = (3, 5, 7, 9, 11, 13, 17, 19)


def node_probe(number: int) -> tuple[bytes, wire.ReplyCheck]:
    """Return the n-th who-are-you read of a node, a `hdbench.devices.wire.Probe`."""
    count = _PROBE_COUNTS[number % len(_PROBE_COUNTS)]
    return wire.read_registers(reg.IDENTITY[0].address, count)


def span(group: Sequence[Register]) -> tuple[int, int]:
    """Return address and number of adjacent registers."""
    return group[0].address, sum(entry.size for entry in group)


def writable(group: Sequence[Register], values: bytes) -> tuple[int, int]:
    """Return address and number of a write; only registers that the map calls writable pass."""
    closed = [entry.name for entry in group if not entry.writable]
    address, count = span(group)
    if closed or len(values) != 2 * count:
        raise ValueError(f"{len(values)} bytes for {count} registers; not writable: {closed}")
    return address, count


# codes fill 16 bits from the left
_FEWEST_BITS, _MOST_BITS = 8, 16
_ABOVE_ZERO = ("range_v", "current_range_a", "limit_velocity_rad_s")


def parameter_values(settings: DaqSettings, limits: Mapping[str, Value]) -> dict[str, Value]:
    """Return the values of the parameter block, by register name."""
    program = settings.reference if isinstance(settings.reference, ReferenceProgram) else None
    wave = settings.reference if isinstance(settings.reference, ReferenceWave) else None
    values: dict[str, Value] = {
        "sample_period_ns": round(1e9 * settings.sample_period_s),
        "n_samples": settings.n_samples,
        "wave": reg.WAVES.index(wave.wave) if wave else reg.PROGRAM_WAVE if program else 0,
        **{name: as_float32(getattr(wave, name) if wave else 0.0) for name in reg.WAVE_NUMBERS},
        "watchdog_ms": round(1e3 * settings.watchdog_s),
        "channels": channel_bits(settings.roles, settings.sample_period_s, limits),
    }
    _check(values, "sample_period_ns", limits["min_period_ns"], limits["max_period_ns"])
    _check(values, "n_samples", 1, limits["max_samples"])
    _check(values, "watchdog_ms", limits["watchdog_min_ms"], limits["watchdog_max_ms"])
    return values


def part_values(program: ReferenceProgram) -> list[dict[str, Value]]:
    """Return the values of the program block, one for each part, by register name."""
    return [
        {
            "program_part": number,
            "program_parts": len(program.parts),
            "part_samples": part.n_samples,
            **{f"part_{name}": as_float32(getattr(part, name)) for name in reg.PART_NUMBERS},
        }
        for number, part in enumerate(program.parts)
    ]


def _check(values: Mapping[str, Value], name: str, low: Value, high: Value) -> None:
    if not float(low) <= float(values[name]) <= float(high):
        raise DeviceError(
            f"{name} {values[name]} is outside the node's {low} to {high}",
            where=f"register {name} (0x{reg.register(name).address:04X})",
            fix="change the plan, or [daq] of the profile",
        )


class NodeAccess(Transactor):
    """Everything of a node but its acquisition: registers, identity, limits, parameters.

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

    _kind = "node"
    _fix = "check address, power and cable of the node, then run `hdbench doctor`"
    _identity: Identity | None = None
    _limits: dict[str, Value] | None = None
    _shown = b""
    _has_program = False

    def __init__(
        self, link: wire.Link, *, deadline_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(link, deadline_s=deadline_s, clock=clock)
        self._session = 0
        self._heartbeat = 0
        self._nonce = 0

    def read(self, group: Sequence[Register]) -> bytes:
        """Return the bytes of adjacent registers."""
        address, count = span(group)
        return self._repeat(lambda: wire.read_registers(address, count), group[0].name)

    def read_status(self) -> bytes:
        """Return the status block of this moment, tagged so that it can be no older one."""
        address, count = span(reg.STATUS)

        def build() -> tuple[bytes, wire.ReplyCheck]:
            self._nonce = self._nonce % 0xFFFF + 1
            nonce = struct.pack(">H", self._nonce)
            pdu, exact = wire.exchange_registers(address, count, reg.NONCE[0].address, nonce)

            def check(reply: bytes) -> None:
                exact(reply)
                if reply[-2:] != nonce:
                    raise wire.StaleReply

            return pdu, check

        return self._repeat(build, reg.STATUS[0].name)

    def exchange(self, window: BlockExchange, ack: int) -> bytes:
        """Acknowledge a block, feed the watchdog and read the window, in one transaction."""

        def build() -> tuple[bytes, wire.ReplyCheck]:
            self._heartbeat = self._heartbeat % 0xFFFF + 1
            return window.build(ack, self._heartbeat)

        return self._repeat(build, reg.BLOCK[0].name)

    def feed(self) -> None:
        """Write a changed heartbeat, outside of the block exchange."""
        self._heartbeat = self._heartbeat % 0xFFFF + 1
        self.write_once((reg.register("heartbeat"),), struct.pack(">H", self._heartbeat))

    def write_once(self, group: Sequence[Register], values: bytes) -> None:
        """Write `values` to adjacent registers, sent exactly once."""
        address, count = writable(group, values)
        request = (
            wire.write_register(address, int.from_bytes(values, "big"))
            if count == 1
            else wire.write_registers(address, values)
        )
        self.transact(lambda: request, group[0].name, 1)

    def take_session(self, token: int) -> None:
        """Write the session's token; it is shown again on every later connection."""
        self._session = 0
        self.write_once((reg.register("session"),), struct.pack(">I", token))
        self._session = token

    def close(self) -> None:
        """Give the session back and close the connection; never raises."""
        if self._session:
            try:
                self.take_session(0)
            except HdbenchError:
                # the node ends the session by itself once the connection is gone
                self._link.close()
        super().close()

    def _reopened(self, until_s: float) -> None:
        """Make sure that it is the same node; the same exchange shows it the session's token."""
        if not self._session:
            super()._reopened(until_s)
            return
        address, token = reg.register("session").address, struct.pack(">I", self._session)
        asked = wire.exchange_registers(*span(reg.IDENTITY), address, token)
        try:
            self._send(*same_reply(asked, self._shown), until_s)
        except wire.ExceptionReply:
            # the session is lost; without it a new connection may still read, and stop the motor
            self._session = 0
            raise

    def _repeat(self, build: Build, name: str) -> bytes:
        return self.transact(build, name, TWICE)[2:]

    def _refused(self, reply: wire.ExceptionReply, name: str, until_s: float) -> HdbenchError:
        """Return what the node's exception means, with its own reason where it gives one."""
        reason, address = self._reason(until_s)
        entry = reg.register_at(address) if reason else None
        where = self._place(entry.name if entry else name)
        why = f": {reason.name.lower().replace('_', ' ')}" if reason else ""
        what = f"the node refused with {reply}{why}"
        if reason == reg.Refusal.SESSION_HELD:
            fix = "wait until the other host has finished; a killed one loses its session in 2 s"
            return BusyError(what, where=where, fix=fix)
        fix = "compare the value with the node's limits (docs/node-protocol.md)"
        return DeviceError(what, where=where, fix=fix)

    def _reason(self, until_s: float) -> tuple[reg.Refusal, int]:
        """Ask, once and in what is left of the deadline, why the last request was refused."""
        request = wire.read_registers(reg.register("refusal").address, 2)
        try:
            reply = self._link.transact(*request, until_s)
            code, where = struct.unpack(">HH", reply[2:])
            return reg.Refusal(code), where
        except (wire.ExceptionReply, wire.FrameError, ValueError):
            return reg.Refusal.NONE, 0

    def _fault(self, what: str, name: str) -> DeviceError:
        for told, fix in _FIXES.items():
            if told in what:
                return self.error(what, name, fix)
        return super()._fault(what, name)

    def _place(self, name: str) -> str:
        return f"{self.where}, register {name} (0x{reg.register(name).address:04X})"

    def identity(self) -> Identity:
        """Return who answers; asked once, before anything is written."""
        if self._identity is None:
            request = wire.read_registers(*span(reg.IDENTITY))
            reply = self.transact(lambda: request, reg.IDENTITY[0].name, TWICE)
            values = decode_group(reg.IDENTITY, reply[2:])
            if values["word_order"] != reg.WORD_ORDER_TEST:
                raise self.error(
                    f"word order test reads 0x{values['word_order']:08X}; "
                    f"needed: 0x{reg.WORD_ORDER_TEST:08X}",
                    "word_order",
                    "this is no bench controller node, or its word order is swapped",
                )
            if values["protocol_version"] != reg.PROTOCOL_VERSION:
                raise self.error(
                    f"map version {values['protocol_version']}; needed: {reg.PROTOCOL_VERSION}",
                    "protocol_version",
                    "update the node's firmware or hdbench",
                )
            self._has_program = bool(int(values["capabilities"]) & reg.Capability.PROGRAM)
            self._identity = Identity(
                **{name: str(values[name]) for name in ("vendor", "model", "serial", "firmware")},
                simulated=bool(int(values["capabilities"]) & reg.Capability.SIMULATED),
            )
            self._shown = reply[2:]
            self.recognise(same_reply(request, self._shown))
        return self._identity

    def limits(self) -> dict[str, Value]:
        """Return the node's own limits and scales, by register name."""
        if self._limits is None:
            found = decode_group(reg.LIMITS, self.read(reg.LIMITS))
            self._check_limits(found)
            self._limits = found
        return self._limits

    def _check_limits(self, found: dict[str, Value]) -> None:
        """Refuse scales that no node can have: everything measured is made with them."""
        fix = "correct the node's firmware (docs/node-protocol.md)"
        bits = int(found["converter_bits"])
        if not _FEWEST_BITS <= bits <= _MOST_BITS:
            what = f"a converter of {bits} bits; needed: {_FEWEST_BITS} to {_MOST_BITS}"
            raise self.error(what, "converter_bits", fix)
        for name in _ABOVE_ZERO:
            # written so that NaN fails
            if not 0.0 < float(found[name]) < math.inf:
                raise self.error(f"{name} is {found[name]}; needed: a number above 0", name, fix)

    def status(self) -> dict[str, Value]:
        """Return the status block of this moment, by register name."""
        return decode_group(reg.STATUS, self.read_status())

    def command(self, command: reg.Command) -> None:
        """Write a command, once."""
        self.write_once((reg.register("command"),), struct.pack(">H", command))

    def make_safe(self) -> None:
        """Order the safe state of a device that is known to be a node."""
        self.identity()
        self.command(reg.Command.SAFE)

    def write_program(self, program: ReferenceProgram) -> None:
        """Write the parts of a program and read each of them back."""
        if not self._has_program:
            raise self.error(
                "this node's generator has no program; needed: bit 2 of the capabilities",
                "capabilities",
                "update the node's firmware (docs/node-protocol.md), or run without --plan",
            )
        for part in part_values(program):
            self.write_and_read_back(reg.PROGRAM, part)

    def write_and_read_back(self, group: tuple[Register, ...], wanted: dict[str, Value]) -> None:
        """Write `wanted` once; what counts is what then stands in the node."""
        was_answered(lambda: self.write_once(group, encode_group(group, wanted)))
        found = decode_group(group, self.read(group))
        for name, value in wanted.items():
            if found[name] != value:
                raise self.error(
                    f"{name} reads back as {found[name]}; written: {value}",
                    name,
                    "run again; if it stays, check the node's firmware",
                )
