"""Emulated node: registers, sessions and refusals around a simulated bench."""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Mapping

from hdbench.devices.emulator.machine import (
    FIFO_SCANS,
    ROUNDING,
    BlockWindow,
    NodeMachine,
    Pace,
    reference_wave,
)
from hdbench.devices.emulator.server import Device, ModbusRefusedError
from hdbench.devices.emulator.serving import Emulation, ModbusWire
from hdbench.devices.node import registers as reg
from hdbench.devices.registers import (
    BLOCK_DATA_REGISTERS,
    Register,
    Space,
    Value,
    decode_group,
    encode_group,
)
from hdbench.plant.bench import SimulatedBench
from hdbench.profile.acquiring import NodeAcquisition
from hdbench.profile.schema import ProfileData
from hdbench.profile.waves import MAX_PARTS, ProgramPart, ReferenceProgram

_MAX_SAMPLES = 100_000_000
DEFAULT_PARAMETERS: Mapping[str, Value] = {
    entry.name: 1_000_000 if entry.name == "sample_period_ns" else 0 for entry in reg.PARAMETERS
}


def identity_values(seed: int) -> Mapping[str, Value]:
    """Return the identity block of the emulator."""
    from hdbench import __version__

    return {
        "word_order": reg.WORD_ORDER_TEST,
        "protocol_version": reg.PROTOCOL_VERSION,
        "capabilities": int(reg.Capability.SIMULATED | reg.Capability.PROGRAM),
        "vendor": "hdbench",
        "model": "emulated node",
        "serial": f"sim-{seed % 1_000_000_000}",
        "firmware": __version__,
    }


def limit_values(profile: ProfileData) -> Mapping[str, Value]:
    """Return the limits block: the profile's limits and scales."""
    return {
        "limit_reference_v": profile.limits.reference_v,
        "limit_velocity_rad_s": profile.limits.velocity_rad_s,
        "velocity_per_volt": profile.servo.velocity_gain_rad_s_per_v,
        "min_period_ns": 100_000,
        "max_period_ns": 1_000_000_000,
        "max_samples": _MAX_SAMPLES,
        "watchdog_min_ms": 20,
        "watchdog_max_ms": 2000,
        "fifo_scans": FIFO_SCANS,
        "block_capacity": BLOCK_DATA_REGISTERS,
        "range_v": profile.daq.range_v,
        "current_range_a": profile.servo.max_current_a,
        "converter_bits": profile.daq.resolution_bits,
        "encoder_counts_per_turn": profile.encoder.counts_per_turn,
    }


def check_parameters(values: Mapping[str, Value], limits: Mapping[str, Value]) -> None:
    """Refuse a parameter block that is outside the node's limits."""
    for name, low, high, reason in (
        ("sample_period_ns", limits["min_period_ns"], limits["max_period_ns"], "SAMPLE_PERIOD"),
        ("watchdog_ms", limits["watchdog_min_ms"], limits["watchdog_max_ms"], "WATCHDOG_TIME"),
        ("n_samples", 1, limits["max_samples"], "SAMPLE_COUNT"),
        ("channels", 0, reg.ALL_CHANNELS, "VALUE"),
    ):
        if not float(low) <= float(values[name]) <= float(high):
            raise _refused(name, reg.Refusal[reason])
    peak_v = abs(float(values["bias_v"])) + abs(float(values["amplitude_v"]))
    _check_peak(peak_v, limits, "amplitude_v")
    if not 0 <= int(values["wave"]) < len(reg.WAVES):
        raise _refused("wave", reg.Refusal.WAVE)
    if values["wave"] == reg.PROGRAM_WAVE:
        return
    try:
        reference_wave(values)
    except ValueError as error:
        raise _refused("wave", reg.Refusal.WAVE) from error


def _check_peak(peak_v: float, limits: Mapping[str, Value], name: str) -> None:
    """Refuse a reference, V, beyond the node's limits of volts or of speed."""
    if not peak_v <= float(limits["limit_reference_v"]) * (1.0 + ROUNDING):
        raise _refused(name, reg.Refusal.REFERENCE_LIMIT)
    peak_rad_s = peak_v * float(limits["velocity_per_volt"])
    if not peak_rad_s <= float(limits["limit_velocity_rad_s"]) * (1.0 + ROUNDING):
        raise _refused(name, reg.Refusal.VELOCITY_LIMIT)


def _refused(name: str, reason: reg.Refusal) -> ModbusRefusedError:
    return ModbusRefusedError(3, reason, reg.register(name).address)


class ProgramStore:
    """Parts that a host has written.

    Parameters
    ----------
    limits : mapping
        The limits block, by register name.
    """

    def __init__(self, limits: Mapping[str, Value]) -> None:
        self._limits = limits
        self.forget()

    def forget(self) -> None:
        """Forget the program."""
        self._parts: list[ProgramPart] = []
        self._needed = 0
        self.last: dict[str, Value] = {entry.name: 0 for entry in reg.PROGRAM}

    def take(self, values: Mapping[str, Value], address: int) -> None:
        """Keep one part: part 0 begins a program, any other follows the one before it."""
        if len(values) != len(reg.PROGRAM):
            raise ModbusRefusedError(3, reg.Refusal.VALUE, address)
        number, needed = int(values["program_part"]), int(values["program_parts"])
        kept = self._parts[:number]
        # a part may be written again, as it is when the answer to a write was lost
        follows = number == len(kept) and (number == 0 or needed == self._needed)
        if not (1 <= needed <= MAX_PARTS and number < needed and follows):
            raise _refused("program_part", reg.Refusal.VALUE)
        part = self._checked(values)
        self._parts, self._needed = [*kept, part], needed
        self.last = dict(values)

    def check(self, parameters: Mapping[str, Value]) -> ReferenceProgram | None:
        """Return the program that a parameter block asks for; None where it asks for none."""
        if parameters["wave"] != reg.PROGRAM_WAVE:
            return None
        if not self._parts or len(self._parts) != self._needed:
            raise _refused("wave", reg.Refusal.WAVE)
        program = ReferenceProgram(tuple(self._parts))
        if program.n_samples != int(parameters["n_samples"]):
            raise _refused("n_samples", reg.Refusal.SAMPLE_COUNT)
        return program

    def _checked(self, values: Mapping[str, Value]) -> ProgramPart:
        """Return one part within the limits; a NaN is outside."""
        numbers = {name: float(values[f"part_{name}"]) for name in reg.PART_NUMBERS}
        part = ProgramPart(int(values["part_samples"]), **numbers)
        if not 1 <= part.n_samples <= int(self._limits["max_samples"]):
            raise _refused("part_samples", reg.Refusal.SAMPLE_COUNT)
        _check_peak(part.peak_v, self._limits, "part_start_v")
        frequencies = (part.frequency_hz, part.end_frequency_hz)
        if not all(0.0 <= f < math.inf for f in frequencies):
            raise _refused("part_frequency_hz", reg.Refusal.VALUE)
        return part


FREE, MINE, HELD = 0, 1, 2
_STOPPING = (reg.Command.STOP, reg.Command.SAFE)
# a session whose connection is gone stays for a host that reconnects
_KEPT_S = 2.0
# acknowledgement and heartbeat
_FEED = struct.Struct(">HH")
_FEED_AT = reg.FEED[0].address
# a pseudo-terminal passes characters at once; hosts reckon with the fastest usual rate
_QUERY = "?baud=921600"


class Session:
    """The right to write.

    Parameters
    ----------
    clock : callable
        Monotonic clock, s.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._token = 0
        self._owner: int | None = None
        self._orphaned_s = 0.0

    def state(self, connection: int) -> int:
        """Return `FREE`, `MINE` or `HELD` as seen from `connection`."""
        if not self._token:
            return FREE
        return MINE if self._owner == connection else HELD

    def take(self, token: int, connection: int) -> None:
        """Take, take over (same token) or give back (0) the session."""
        if self.state(connection) == HELD and token != self._token:
            raise ModbusRefusedError(6, reg.Refusal.SESSION_HELD, reg.register("session").address)
        self._token = token
        self._owner = connection if token else None

    def disconnected(self, connection: int) -> None:
        """Note that a connection is gone."""
        if self._owner == connection:
            self._owner = None
            self._orphaned_s = self._clock()

    def tick(self) -> None:
        """End a session whose host has not come back."""
        orphaned = self._token and self._owner is None
        if orphaned and self._clock() - self._orphaned_s > _KEPT_S:
            self._token = 0


class NodeCore(Device):
    """Answers reads and writes of registers for any number of connections.

    Parameters
    ----------
    machine : NodeMachine
        The node's acquisition and motor.
    identity, limits : mapping
        Values of the two read-only blocks.
    clock : callable
        Monotonic clock, s.
    """

    functions = frozenset((3, 6, 16, 23))

    def __init__(
        self,
        machine: NodeMachine,
        *,
        identity: Mapping[str, Value],
        limits: Mapping[str, Value],
        clock: Callable[[], float],
    ) -> None:
        self.machine = machine
        self._identity = encode_group(reg.IDENTITY, identity)
        self._limits_raw = encode_group(reg.LIMITS, limits)
        # limits as a host reads them, rounded to 32-bit floats
        self._limits = decode_group(reg.LIMITS, self._limits_raw)
        self._window = BlockWindow(machine)
        self._session = Session(clock)
        self._parameters = dict(DEFAULT_PARAMETERS)
        self._program = ProgramStore(self._limits)
        self._feed = {"ack": 0, "heartbeat": 0}
        self._command = 0
        self._refusals: dict[int, tuple[int, int]] = {}
        self._nonces: dict[int, int] = {}
        self._images: dict[tuple[Register, ...], Callable[[int], bytes]] = {
            reg.BLOCK: lambda _: self._window.image(self._feed["heartbeat"]),
            reg.IDENTITY: lambda _: self._identity,
            reg.LIMITS: lambda _: self._limits_raw,
            reg.STATUS: lambda connection: encode_group(reg.STATUS, self._status(connection)),
            reg.FEED: lambda _: encode_group(reg.FEED, self._feed),
            reg.NONCE: lambda connection: struct.pack(">H", self._nonces.get(connection, 0)),
            reg.PARAMETERS: lambda _: encode_group(reg.PARAMETERS, self._parameters),
            reg.CONTROL: lambda _: struct.pack(">H", self._command),
            reg.SESSION: lambda _: bytes(4),
            reg.PROGRAM: lambda _: encode_group(reg.PROGRAM, self._program.last),
        }

    def read(self, space: Space, address: int, count: int, connection: int) -> bytes:
        """Return the bytes of `count` registers from `address`."""
        group, image = self._at(address, count)
        offset = 2 * (address - group[0].address)
        return image(connection)[offset : offset + 2 * count]

    def write(self, space: Space, address: int, raw: bytes, connection: int) -> None:
        """Write registers; all of them or none."""
        if address == _FEED_AT and len(raw) == _FEED.size:
            # what every exchange writes
            self._refuse_others(connection)
            ack, heartbeat = _FEED.unpack(raw)
            self._accept_feed({"ack": ack, "heartbeat": heartbeat})
            return
        group, _ = self._at(address, len(raw) // 2)
        chosen = _whole_registers(group, address, len(raw) // 2)
        values = decode_group(chosen, raw)
        if group is reg.SESSION:
            self._session.take(int(values["session"]), connection)
            return
        if group is reg.NONCE:
            self._nonces[connection] = int(values["nonce"])
            return
        # anybody may stop the motor at any time
        if values.get("command") not in _STOPPING:
            self._refuse_others(connection)
        if group is reg.FEED:
            self._accept_feed(values)
        elif group is reg.PARAMETERS:
            self._accept_parameters(values)
        elif group is reg.CONTROL:
            self._accept_command(int(values["command"]), address)
        else:
            self._refuse_while_running(address)
            self._program.take(values, address)

    def _at(self, address: int, count: int) -> tuple[tuple[Register, ...], Callable[[int], bytes]]:
        """Return the one group that covers the span, and what gives its bytes."""
        for group, image in self._images.items():
            last = group[-1]
            if group[0].address <= address and address + count <= last.address + last.size:
                return group, image
        raise ModbusRefusedError(2, reg.Refusal.ADDRESS, address)

    def tick(self) -> None:
        """Let the wall clock act."""
        self.machine.tick()
        self._session.tick()

    def hears(self, function: int) -> bool:
        """Bring the node up to now."""
        self.machine.tick()
        return True

    def rest(self) -> None:
        """Produce samples."""
        self.machine.produce_ahead()

    def left(self, connection: int) -> None:
        """Note that a connection is gone."""
        self._refusals.pop(connection, None)
        self._nonces.pop(connection, None)
        self._session.disconnected(connection)

    def note_refusal(self, refused: ModbusRefusedError, connection: int, transaction: int) -> None:
        """Keep the reason; a request that is none as Modbus has it concerns no register."""
        reason = refused.reason
        if reason is None:
            reason = reg.Refusal.VALUE if refused.exception == 3 else reg.Refusal.NONE
        self._refusals[connection] = (reason, refused.address)

    def _status(self, connection: int) -> dict[str, Value]:
        machine = self.machine
        machine.look()
        refusal, refused_address = self._refusals.get(connection, (reg.Refusal.NONE, 0))
        waiting = machine.fifo.depth + self._window.scans
        return {
            "state": int(machine.state),
            "status_flags": machine.flags(),
            "samples_ready": min(waiting, 0xFFFF),
            "starts": machine.starts,
            "samples_taken": machine.fifo.taken,
            "samples_lost": machine.fifo.lost,
            "reference_v": machine.bench.reference_v,
            "velocity_rad_s": machine.bench.velocity_rad_s,
            "encoder_count": (machine.encoder_count + 2**31) % 2**32 - 2**31,
            "device_time_ms": round(1e3 * machine.device_s) % 2**32,
            "mark_start_ms": round(1e3 * machine.mark_start_s) % 2**32,
            "mark_stop_ms": round(1e3 * machine.mark_stop_s) % 2**32,
            "watchdog_trips": machine.trips % 0x10000,
            "refusal": refusal,
            "refused_address": refused_address,
            "session_state": self._session.state(connection),
            "status_echo": self._nonces.get(connection, 0),
        }

    def _accept_feed(self, values: Mapping[str, Value]) -> None:
        if "heartbeat" in values and values["heartbeat"] != self._feed["heartbeat"]:
            self._feed["heartbeat"] = int(values["heartbeat"])
            self.machine.feed_watchdog()
        if "ack" in values:
            self._feed["ack"] = int(values["ack"])
            self._window.acknowledge(self._feed["ack"])

    def _accept_parameters(self, values: Mapping[str, Value]) -> None:
        self._refuse_while_running(reg.PARAMETERS[0].address)
        wanted = {**self._parameters, **values}
        check_parameters(wanted, self._limits)
        self._program.check(wanted)
        self._parameters = wanted
        self.machine.rearm()

    def _accept_command(self, command: int, address: int) -> None:
        if command == reg.Command.START:
            self._refuse_while_running(address)
            if self.machine.state == reg.State.TRIPPED:
                raise ModbusRefusedError(4, reg.Refusal.TRIPPED, address)
            check_parameters(self._parameters, self._limits)
            program = self._program.check(self._parameters)
            self._feed["ack"] = 0
            self._window.clear()
            self.machine.start(self._parameters, program)
        elif command in _STOPPING:
            self.machine.end(reg.State.STOPPED)
            if command == reg.Command.SAFE:
                # a start needs a new parameter block after this
                self._parameters = dict(DEFAULT_PARAMETERS)
                self._program.forget()
        else:
            raise ModbusRefusedError(3, reg.Refusal.VALUE, address)
        self._command = command

    def _refuse_others(self, connection: int) -> None:
        if self._session.state(connection) == HELD:
            raise ModbusRefusedError(6, reg.Refusal.SESSION_HELD, reg.register("session").address)

    def _refuse_while_running(self, address: int) -> None:
        if self.machine.state == reg.State.RUNNING:
            raise ModbusRefusedError(6, reg.Refusal.RUNNING, address)


def _whole_registers(group: tuple[Register, ...], address: int, count: int) -> tuple[Register, ...]:
    """Return the writable entries that the span covers exactly."""
    end = address + count
    chosen = tuple(e for e in group if e.address >= address and e.address + e.size <= end)
    if not group[0].writable or sum(entry.size for entry in chosen) != count:
        raise ModbusRefusedError(2, reg.Refusal.ADDRESS, address)
    return chosen


def build_core(
    bench: SimulatedBench,
    profile: ProfileData,
    seed: int,
    *,
    pace: Pace,
    record: Callable[[Mapping[str, object]], None] = lambda _: None,
    clock: Callable[[], float] = time.monotonic,
) -> NodeCore:
    """Return a node around `bench` with the limits of `profile`."""
    machine = NodeMachine(bench, pace=pace, clock=clock, record=record)
    return NodeCore(
        machine,
        identity=identity_values(seed),
        limits=limit_values(profile),
        clock=clock,
    )


def emulate_node(emulation: Emulation, table: NodeAcquisition) -> ModbusWire:
    """Return a node that makes the motor reference of a simulated bench itself."""
    core = build_core(
        emulation.bench,
        emulation.profile,
        emulation.seed,
        pace=emulation.pace,
        record=emulation.record,
    )
    emulation.moving = lambda: core.machine.busy
    emulation.busy = lambda: core.machine.state == reg.State.RUNNING
    return ModbusWire(core, {"tcp": "", "rtu": _QUERY})
