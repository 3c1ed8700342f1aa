"""A bench controller node as the session's `Bench`."""

from __future__ import annotations

import secrets
import struct
import time
from collections.abc import Callable

import numpy as np

from hdbench.devices.node.blocks import BlockReader
from hdbench.devices.node.codec import Value, as_float32, decode_group, encode_group
from hdbench.devices.node.frames import FrameError
from hdbench.devices.node.registers import (
    BLOCK_SCANS,
    FEED,
    FIXTURE,
    IDENTITY,
    LIMITS,
    PARAMETERS,
    PROGRAM,
    PROTOCOL_VERSION,
    STATUS,
    WORD_ORDER_TEST,
    Capability,
    Command,
    Register,
    State,
    register,
)
from hdbench.devices.node.safe import reach_safe_state
from hdbench.devices.node.settings import parameter_values, part_values
from hdbench.devices.node.wire import NodeWire
from hdbench.devices.ports import AcquisitionSettings, Block, Identity, SafeState
from hdbench.errors import DeviceError
from hdbench.model.program import ReferenceProgram

__all__ = ["NodeBench"]


class NodeBench:
    """Driver of one node; implements `hdbench.devices.ports.Bench`.

    Parameters
    ----------
    wire : NodeWire
        Register access; owned by the driver from now on.
    watchdog_s : float
        Host silence after which the node zeroes the motor, s.
    clock, sleep : callable, optional
        Monotonic clock in s, and waiting.
    """

    def __init__(
        self,
        wire: NodeWire,
        *,
        watchdog_s: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._wire = wire
        self._watchdog_ms = round(1000.0 * watchdog_s)
        self._clock = clock
        self._sleep = sleep
        self._identity: Identity | None = None
        self._limits: dict[str, Value] = {}
        self._reader: BlockReader | None = None
        self._settings: AcquisitionSettings | None = None
        self._starts = 0
        self._next_poll_s = 0.0

    def identity(self) -> Identity:
        """Return who answers; asked once, before anything is written."""
        if self._identity is None:
            values = decode_group(IDENTITY, self._wire.read(IDENTITY))
            if values["word_order"] != WORD_ORDER_TEST:
                raise self._error(
                    f"word order test reads 0x{values['word_order']:08X}; "
                    f"needed: 0x{WORD_ORDER_TEST:08X}",
                    "word_order",
                    "this is no bench controller node, or its word order is swapped",
                )
            if values["protocol_version"] != PROTOCOL_VERSION:
                raise self._error(
                    f"map version {values['protocol_version']}; needed: {PROTOCOL_VERSION}",
                    "protocol_version",
                    "update the node's firmware or hdbench",
                )
            self._identity = Identity(
                vendor=str(values["vendor"]),
                model=str(values["model"]),
                serial=str(values["serial"]),
                firmware=str(values["firmware"]),
                simulated=bool(int(values["capabilities"]) & Capability.SIMULATED),
            )
        return self._identity

    def limits(self) -> dict[str, Value]:
        """Return the node's own limits and scales, by register name."""
        if not self._limits:
            self._limits = decode_group(LIMITS, self._wire.read(LIMITS))
        return self._limits

    def take_session(self) -> None:
        """Become the one host that may write.

        Raises
        ------
        BusyError
            If another host holds the node.
        """
        self.identity()
        self._wire.take_session(secrets.randbelow(0xFFFFFFFF) + 1)

    def configure(self, settings: AcquisitionSettings) -> None:
        """Write the parameter block with the watchdog time, and read it back."""
        self.identity()
        wanted = parameter_values(settings, self._watchdog_ms, self.limits())
        if isinstance(settings.reference, ReferenceProgram):
            self._write_program(settings.reference)
        self._write_and_read_back(PARAMETERS, wanted)
        self._settings = settings
        self._reader = None

    def _write_program(self, program: ReferenceProgram) -> None:
        """Write the parts of a program and read each of them back."""
        values = decode_group(IDENTITY, self._wire.read(IDENTITY))
        if not int(values["capabilities"]) & Capability.PROGRAM:
            raise self._error(
                "this node's generator has no program; needed: bit 2 of the capabilities",
                "capabilities",
                "update the node's firmware (docs/node-protocol.md), or run without --plan",
            )
        for part in part_values(program):
            self._write_and_read_back(PROGRAM, part)

    def start(self) -> None:
        """Start sampling and, with a reference, the motion; sent once, then read back."""
        if self._settings is None:
            raise self._error("no acquisition is configured", "command", "configure it first")
        before = self.status()
        reader = BlockReader(self.limits(), self._settings.n_samples, self._wire.where)
        try:
            self._command(Command.START)
        except DeviceError as error:
            if not isinstance(error.__cause__, FrameError):
                raise
            # no answer: whether it was carried out stands in the counter of starts
        after = self.status()
        if after["starts"] == before["starts"]:
            raise self._error("the node did not start", "command", "configure it again")
        self._starts = int(after["starts"])
        self._reader = reader
        self._next_poll_s = 0.0

    def read_block(self) -> Block | None:
        """Acknowledge the previous block and return the next; None when none is ready yet.

        Notes
        -----
        After an empty answer the next call waits a fraction of a block first, so that a caller may
        simply call again.
        """
        reader = self._reader
        if reader is None:
            raise self._error("no acquisition has been started", "block_seq", "start it first")
        wait_s = self._next_poll_s - self._clock()
        if wait_s > 0.0:
            self._sleep(wait_s)
        raw = self._wire.exchange(reader.window, FEED, reader.feed())
        block = reader.take(raw)
        if reader.ended_early:
            self._check_not_restarted()
        if not block:
            self._next_poll_s = self._clock() + self._poll_period_s()
        return block

    def stop(self) -> None:
        """Stop the acquisition normally; samples already taken can still be read."""
        try:
            self._command(Command.STOP)
        except DeviceError:
            # stopping twice does no harm, starting twice would: only this command is repeated
            self._command(Command.STOP)
        status = self.status()
        if status["state"] == State.RUNNING:
            raise self._error("the node still runs after stop", "state", "use the emergency stop")
        if self._reader is not None:
            self._reader.stopped = True

    def status(self) -> dict[str, Value]:
        """Return the status block, by register name."""
        return decode_group(STATUS, self._wire.read(STATUS))

    def set_fixture(
        self, *, locked: bool, position_rad: float, mass_kg: float, direction: int
    ) -> None:
        """Set lock, flexspline position and weight of a simulated bench, and read them back.

        Raises
        ------
        DeviceError
            If the node is no simulated bench, refuses, or reads back otherwise.
        """
        if not self.identity().simulated:
            raise self._error(
                "a real bench has no simulated fixture", "fixture_locked", "ask the operator"
            )
        wanted: dict[str, Value] = {
            "fixture_locked": int(locked),
            "fixture_direction": direction,
            "fixture_position_rad": as_float32(position_rad),
            "fixture_mass_kg": as_float32(mass_kg),
        }
        self._write_and_read_back(FIXTURE, wanted)

    def safe_state(self) -> SafeState:
        """Make the bench safe from any state, twice if need be; never raises.

        Notes
        -----
        Safe is: not running, reference zero, drive disabled and the motor slower than 0.5 rad/s in
        two readings. The motor gets 2.5 s to decelerate.
        """
        safe = reach_safe_state(self._make_safe, self.status, self._clock, self._sleep)
        self._reader = None
        self._settings = None
        return safe

    def close(self) -> None:
        """Give the session back and close the connection; never raises."""
        self._wire.close()

    def _make_safe(self) -> None:
        self._command(Command.SAFE)

    def _command(self, command: Command) -> None:
        self._wire.write_once((register("command"),), struct.pack(">H", command))

    def _write_and_read_back(self, group: tuple[Register, ...], wanted: dict[str, Value]) -> None:
        """Write `wanted` once; what counts is what then stands in the node."""
        try:
            self._wire.write_once(group, encode_group(group, wanted))
        except DeviceError as error:
            if not isinstance(error.__cause__, FrameError):
                raise
        found = decode_group(group, self._wire.read(group))
        for name, value in wanted.items():
            if found[name] != value:
                raise self._error(
                    f"{name} reads back as {found[name]}; written: {value}",
                    name,
                    "run again; if it stays, check the node's firmware",
                )

    def _check_not_restarted(self) -> None:
        if self.status()["starts"] != self._starts:
            raise self._error(
                "the node was restarted during the acquisition: its samples are gone",
                "starts",
                "check the node's power supply, then run again",
            )

    def _poll_period_s(self) -> float:
        period_s = self._settings.sample_period_s if self._settings else 1e-3
        # a quarter of a block keeps the delay small; 20 ms feed any watchdog often enough
        return float(np.clip(0.25 * BLOCK_SCANS * period_s, 0.002, 0.02))

    def _error(self, what: str, name: str, fix: str) -> DeviceError:
        entry = register(name)
        return DeviceError(
            what, where=f"{self._wire.where}, register {name} (0x{entry.address:04X})", fix=fix
        )
