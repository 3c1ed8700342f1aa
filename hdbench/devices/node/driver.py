"""Driver of a bench controller node, a `Daq` with a reference generator of its own."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from functools import partial

import numpy as np

from hdbench.devices import daq
from hdbench.devices.bench import SafeState
from hdbench.devices.driver import Driver, later
from hdbench.devices.guard.order import Check, Look, Target, target_at
from hdbench.devices.node import registers as reg
from hdbench.devices.node.access import NodeAccess, node_probe, parameter_values, span
from hdbench.devices.node.blocks import BlockReader
from hdbench.devices.registers import Value, decode_group
from hdbench.devices.safestate import STANDSTILL_RAD_S, Seen, reach_safe_state
from hdbench.devices.transactor import was_answered
from hdbench.devices.wire.address import Address, address_of, parse_address
from hdbench.devices.wire.link import connect, read_registers, write_register
from hdbench.errors import BusyError, DeviceError, HdbenchError, UsageError
from hdbench.profile.acquiring import NodeAcquisition
from hdbench.profile.schema import ProfileData
from hdbench.profile.waves import ReferenceProgram

# characters around the registers of an FC23 exchange on a serial line: request with two registers
# written; unit, function, byte count and checksum of the reply
REQUEST_CHARACTERS = 17
REPLY_CHARACTERS = 5
# share of the wire's limit that is sustained (measured: docs/devices.md)
_SUSTAINED = 0.9
# a device on Ethernet answers within a millisecond or two; two on the safe side
_NETWORK_EXCHANGE_S = 0.002


def exchange_rate_hz(address: Address, n_channels: int) -> float:
    """Return the sustained rate of block exchanges, Hz."""
    if address.scheme != "rtu":
        return 1.0 / _NETWORK_EXCHANGE_S
    received = REPLY_CHARACTERS + 2 * reg.block_registers(n_channels)
    return _SUSTAINED / address.serial.exchange_s(REQUEST_CHARACTERS, received)


def _input(role: daq.Role, limits: Mapping[str, Value]) -> daq.InputInfo:
    if role == "encoder":
        return daq.InputInfo(role, -(2.0**31), 2.0**31 - 1.0, bits=32, wrap=2**32)
    key = "current_range_a" if daq.ROLE_UNITS[role] == "A" else "range_v"
    bits = int(limits["converter_bits"])
    top = 1.0 - 2.0 ** (1 - bits)
    return daq.InputInfo(role, -float(limits[key]), top * float(limits[key]), bits=bits)


@dataclass(eq=False)
class NodeDaq:
    """Driver of one node; implements `hdbench.devices.daq.Daq`.

    Parameters
    ----------
    node : NodeAccess
        The node; owned by the driver from now on.
    exchanges_hz : callable
        Highest rate of block exchanges with n channels that the wire sustains, Hz.
    tacho_rad_s_per_v : float
        Scale of the tacho, for `snapshot`, rad/s/V.
    clock, sleep : callable, optional
        Monotonic clock in s, and waiting.
    """

    node: NodeAccess
    _: KW_ONLY
    exchanges_hz: Callable[[int], float]
    tacho_rad_s_per_v: float
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep

    def __post_init__(self) -> None:
        node = self.node
        self.identity, self.limits, self.status = node.identity, node.limits, node.status
        # a block exchange feeds the watchdog, too
        self.feed_watchdog, self.close = node.feed, node.close
        self._reader: BlockReader | None = None
        self._settings: daq.DaqSettings | None = None
        self._next_poll_s = 0.0

    @property
    def repeats(self) -> int:
        """Requests that were sent again so far."""
        return self.node.repeats

    def capabilities(self) -> daq.Capabilities:
        """Return what the node can do over this wire."""
        limits = self.limits()
        fastest_hz = 1e9 / float(limits["min_period_ns"])
        rates = tuple(
            min(fastest_hz, self.exchanges_hz(n) * reg.block_scans(n))
            for n in range(1, len(reg.CHANNELS) + 1)
        )
        return daq.Capabilities(
            inputs=tuple(_input(role, limits) for role in reg.CHANNELS),
            max_rates_hz=rates,
            min_rate_hz=1e9 / float(limits["max_period_ns"]),
            generator=True,
            enable=True,
            watchdog=daq.WatchdogInfo(
                min_s=1e-3 * float(limits["watchdog_min_ms"]),
                max_s=1e-3 * float(limits["watchdog_max_ms"]),
                fed_by="heartbeat",
                drops=("reference", "enable"),
            ),
        )

    def claim(self) -> None:
        """Become the one host that may write."""
        self.identity()
        self.node.take_session(secrets.randbelow(0xFFFFFFFF) + 1)

    def configure(self, settings: daq.DaqSettings) -> float:
        """Write the parameter block with the watchdog time, read it back, return the period, s."""
        self.identity()
        wanted = parameter_values(settings, self.limits())
        if isinstance(settings.reference, ReferenceProgram):
            self.node.write_program(settings.reference)
        self.node.write_and_read_back(reg.PARAMETERS, wanted)
        self._settings = settings
        self._reader = None
        return 1e-9 * float(wanted["sample_period_ns"])

    def start(self) -> None:
        """Start sampling and, with a reference, the motion; sent once, then read back."""
        if self._settings is None:
            raise self.node.error("no acquisition is configured", "command", "configure it first")
        before = self.status()
        # without an answer, whether it was carried out stands in the counter of starts
        was_answered(lambda: self.node.command(reg.Command.START))
        after = self.status()
        if after["starts"] == before["starts"]:
            raise self.node.error("the node did not start", "command", "configure it again")
        self._reader = BlockReader(
            self.limits(), self._settings, run=int(after["starts"]), where=self.node.where
        )
        self._next_poll_s = 0.0

    def read_block(self) -> daq.ScanBlock | None:
        """Acknowledge the previous block and return the next; None when none is ready yet.

        Notes
        -----
        After an empty answer the next call waits a fraction of a block first, so that a caller may
        simply call again.
        """
        reader = self._reader
        if reader is None:
            raise self.node.error("no acquisition has been started", "block_seq", "start it first")
        wait_s = self._next_poll_s - self.clock()
        if wait_s > 0.0:
            self.sleep(wait_s)
        asked_s = self.clock()
        raw = self.node.exchange(reader.window, reader.ack)
        block = reader.take(raw, (asked_s, self.clock()))
        if reader.ended_early:
            raise self.node.error(
                "the acquisition ended before its samples were taken",
                "block_seq",
                "something else stopped the node; run again",
            )
        if not block:
            self._next_poll_s = self.clock() + self._poll_period_s()
        return block

    def stop(self) -> None:
        """Stop the acquisition normally; samples already taken can still be read."""
        try:
            self.node.command(reg.Command.STOP)
        except DeviceError:
            # stopping twice does no harm, starting twice would: only this command is repeated
            self.node.command(reg.Command.STOP)
        status = self.status()
        if status["state"] == reg.State.RUNNING:
            raise self.node.error(
                "the node still runs after stop", "state", "use the emergency stop"
            )
        if self._reader is not None:
            self._reader.stopped = True

    def write_output(self, name: str, value: float) -> float:
        """Refuse: a node makes its reference itself."""
        raise self.node.error(
            f"a node has no output {name!r} for the host to write",
            "wave",
            "give the reference to its generator",
        )

    def enable(self, *, on: bool) -> bool:
        """Switch the drive off; on it goes by itself with a start."""
        if on:
            raise self.node.error(
                "a node enables its drive by itself", "command", "start an acquisition"
            )
        self.node.make_safe()
        return bool(int(self.status()["status_flags"]) & reg.Flag.DRIVE_ENABLED)

    def arm_watchdog(self, time_s: float) -> float:
        """Return the watchdog's time, s; `configure` sets it and a start arms it."""
        found_s = self._watchdog_s()
        if not found_s <= time_s:
            raise self.node.error(
                f"the watchdog's time is {found_s:g} s; needed: at most {time_s:g} s",
                "watchdog_ms",
                "configure the acquisition again",
            )
        return found_s

    def watchdog(self) -> daq.WatchdogState:
        """Return the watchdog's state."""
        state = self.status()["state"]
        running, tripped = state == reg.State.RUNNING, state == reg.State.TRIPPED
        return daq.WatchdogState(running, tripped, self._watchdog_s())

    def clear_watchdog(self) -> None:
        """Clear a latched trip by writing the parameter block as it stands."""
        if self._settings is None or self.status()["state"] != reg.State.TRIPPED:
            return
        self.node.write_and_read_back(
            reg.PARAMETERS, parameter_values(self._settings, self.limits())
        )

    def snapshot(self) -> Mapping[daq.Role, float]:
        """Return reference, V, speed as tacho volts, and encoder count of this moment."""
        status = self.status()
        return {
            "reference": float(status["reference_v"]),
            "tacho": float(status["velocity_rad_s"]) / self.tacho_rad_s_per_v,
            "encoder": float(status["encoder_count"]),
        }

    def safe_state(self) -> SafeState:
        """Make the bench safe from any state, twice if need be; never raises.

        Notes
        -----
        Safe is: not running, reference zero, drive disabled and the motor slower than 0.5 rad/s in
        two readings. The motor gets 2.5 s to decelerate.
        """
        safe = reach_safe_state(
            stop=self.node.make_safe,
            look=self._seen,
            zero_v=0.0,
            clock=self.clock,
            sleep=self.sleep,
        )
        self._reader = None
        self._settings = None
        return safe

    def _watchdog_s(self) -> float:
        values = decode_group(reg.PARAMETERS, self.node.read(reg.PARAMETERS))
        return 1e-3 * float(values["watchdog_ms"])

    def _seen(self) -> Seen:
        status = self.status()
        problem = ""
        if status["state"] == reg.State.RUNNING:
            problem = "the node still runs"
        elif int(status["status_flags"]) & reg.Flag.DRIVE_ENABLED:
            problem = "the drive is still enabled"
        return Seen(float(status["reference_v"]), float(status["velocity_rad_s"]), problem)

    def _poll_period_s(self) -> float:
        settings = self._settings
        block_s = (
            reg.block_scans(len(settings.roles)) * settings.sample_period_s if settings else 0.0
        )
        # a quarter of a block keeps the delay small; 20 ms feed any watchdog often enough
        return float(np.clip(0.25 * block_s, 0.002, 0.02))


# rates at which a port is asked for a node, fastest first
_RATES_BD = (921600, 115200)
_PROBE_S = 0.3


def open_node(profile: ProfileData, table: NodeAcquisition) -> NodeDaq:
    """Return the driver of the node in `table`."""
    address = node_address(table)
    link = connect(address, unit=table.unit, probe=node_probe, tls=table.tls)
    return NodeDaq(
        NodeAccess(link, deadline_s=table.deadline_s),
        exchanges_hz=partial(exchange_rate_hz, address),
        tacho_rad_s_per_v=profile.tacho.gain_rad_s_per_v,
    )


def node_address(table: NodeAcquisition) -> Address:
    """Return the parsed address of a table with its serial settings."""
    address = address_of(table)
    if address.scheme not in ("tcp", "tls", "rtu"):
        raise UsageError(
            f"{table.address[:80]!r}: a node is reached by tcp://HOST:PORT, tls:// or rtu://",
            where="address",
            fix="for example tcp://192.168.0.7:502",
        )
    return address


def node_rate_hz(table: NodeAcquisition) -> float:
    """Return the highest scan rate that the wire of `table` sustains, Hz; inf where embedded."""
    if table.address == "embedded":
        return float("inf")
    n_channels = len(table.channels)
    return exchange_rate_hz(node_address(table), n_channels) * reg.block_scans(n_channels)


def probe(path: str) -> str:
    """Ask a port for the identity of a node, at the usual rates."""
    last: HdbenchError | None = None
    for rate_bd in _RATES_BD:
        link = connect(parse_address(f"rtu://{path}?baud={rate_bd}"), probe=node_probe)
        wire = NodeAccess(link, deadline_s=_PROBE_S)
        try:
            values = decode_group(reg.IDENTITY, wire.read(reg.IDENTITY))
        except BusyError:
            raise
        except HdbenchError as error:
            last = error
            continue
        finally:
            wire.close()
        if values["word_order"] == reg.WORD_ORDER_TEST:
            who = " ".join(str(values[key]) for key in ("vendor", "model", "serial"))
            return f"bench controller node: {who} (rtu://{path}?baud={rate_bd})"
    if last is not None:
        raise last
    return ""


def stop_target(_profile: ProfileData, table: NodeAcquisition) -> Target:
    """Return how a node stops the motor."""
    first, count = span(reg.STATUS)

    def at(name: str) -> int:
        return 2 + 2 * (reg.register(name).address - first)

    active = reg.Flag.RUNNING | reg.Flag.DRIVE_ENABLED
    checks = (
        Check("motor reference, V", at("reference_v"), ">f", 0.0, 0.0),
        Check(
            "motor speed, rad/s", at("velocity_rad_s"), ">f", -STANDSTILL_RAD_S, STANDSTILL_RAD_S
        ),
        Check("running or enabled, flags", at("status_flags"), ">H", 0, 0, mask=int(active)),
    )
    return Target(
        target_at(node_address(table), table.unit, table.tls),
        acts=(write_register(reg.register("command").address, reg.Command.SAFE),),
        looks=(Look(read_registers(first, count), checks),),
        identity=(Look(read_registers(*span(reg.IDENTITY))),),
    )


DRIVER = Driver(
    open=open_node,
    rate_hz=node_rate_hz,
    stop_target=stop_target,
    emulate=later("hdbench.devices.emulator.node:emulate_node"),
    probe=probe,
)
