"""Wrong, stale, duplicate, reordered and mutated replies between the driver and a polled device.

Usage: python tools/faults/polled.py [--faults 10000] [--wire tcp|rtu|rtu+tcp] [--kind KIND]

The device answers every request with a number of its own and a second one that belongs to it, so
that every reading tells whether it was made for this very request. Writes go to an output that is
read back. A line per wire and kind: replies changed, readings delivered and wrong ones among them,
writes confirmed and wrong ones among them, calls that failed, the worst time of a call over its
deadline. What a wire cannot tell stands in docs/modbus-devices.md: these kinds are listed, and do
not count as failures: a changed bit inside TCP (no checksum of its own), and an earlier reply of
the same length in the place of the right one on RTU (no number), a copy of one among them.
"""

from __future__ import annotations

import argparse
import json
import sys
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from faults.lines import Deadlines, behind, emulated
from faults.mangler import FaultKind, Mangler, RtuFraming, TcpFraming
from hdbench.devices.emulator.memory import Cell, Memory
from hdbench.devices.emulator.server import Device
from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.identity import check_identity, make_probe
from hdbench.devices.modbus.layout import place_of
from hdbench.devices.modbus.outputs import Outputs
from hdbench.devices.modbus.replies import polled_link
from hdbench.devices.registers import Register, Space
from hdbench.devices.wire.address import parse_address
from hdbench.devices.wire.rtu import crc16
from hdbench.errors import DeviceError, ProfileError
from hdbench.profile.acquiring_modbus import ModbusAcquisition

__all__ = ["KINDS", "Outcome", "campaign"]

KINDS: tuple[FaultKind, ...] = (
    "function", "count", "unit", "exception", "truncate", "garbage", "transaction", "protocol",
    "header", "echo", "late", "stale", "duplicate", "reorder", "mutate", "drop",
)  # fmt: skip
WIRES = ("tcp", "rtu", "rtu+tcp")
NUMBERED: tuple[FaultKind, ...] = ("transaction", "protocol")
# nothing on these wires tells these from right replies; a copy only where it comes so late that the
# next request has been sent
UNTOLD = {("tcp", "mutate")} | {
    (wire, kind) for wire in ("rtu", "rtu+tcp") for kind in ("stale", "duplicate")
}
# on a serial line every fault costs a wait for late replies: fewer of them, so that calls succeed
SHARES = {"tcp": 0.3, "rtu": 0.1, "rtu+tcp": 0.1}
HOPELESS = 50
# of a late reply, in deadlines: on a serial line within what the driver waits for late ones
LATE = {"tcp": 1.2, "rtu": 0.34, "rtu+tcp": 0.34}
DEADLINES_S = {"tcp": 0.06, "rtu": 0.4, "rtu+tcp": 0.4}
TABLE = ModbusAcquisition.model_validate(
    {
        "driver": "modbus",
        "sample_period_s": 0.1,
        "channels": (
            {"role": "torque", "address": 100, "type": "u32"},
            {"role": "tacho", "address": 102, "type": "u32"},
        ),
        "identify": ({"address": 104, "type": "u16", "equals": 4660},),
        "output": {"address": 200, "type": "i16", "scale": 0.001, "limit_v": 10.0},
    }
)
MODULUS = 2**32


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one campaign.

    Parameters
    ----------
    wire, kind : str
        The wire and the fault.
    faults : int
        Replies changed.
    readings, wrong_readings : int
        Readings delivered, and those that were not made for their request.
    writes, wrong_writes : int
        Writes confirmed, and those after which another value stood in the register.
    failed_calls : int
        Calls that ended with an error.
    calls_over, held_up : int
        Calls of more than 1.1 deadlines, and those among them for want of a processor.
    worst_over_deadline : float
        Longest call over its deadline, 1.
    """

    wire: str
    kind: str
    faults: int
    readings: int
    wrong_readings: int
    writes: int
    wrong_writes: int
    failed_calls: int
    calls_over: int
    held_up: int
    worst_over_deadline: float


class CountingDevice(Device):
    """Answers each request with its number, and with a second number that belongs to it."""

    functions = frozenset((3, 6, 16))
    unit = 1

    def __init__(self) -> None:
        self.count = 0
        self.memory = Memory()
        torque, tacho = (place_of(TABLE, channel) for channel in TABLE.channels)
        self._cell(torque, lambda: float(self.count))
        self._cell(tacho, lambda: float(partner(self.count)))
        self.memory.add(Cell(place_of(TABLE, TABLE.identify[0]), 4660.0, writable=False))
        if TABLE.output is None:
            raise ValueError("the table has no output")
        self.output = self.memory.add(Cell(place_of(TABLE, TABLE.output)))

    def hears(self, function: int) -> bool:
        """Count one request."""
        self.count += 1
        return True

    def read(self, space: Space, address: int, count: int, connection: int) -> bytes:
        """Return registers."""
        return self.memory.read(space, address, count)

    def write(self, space: Space, address: int, raw: bytes, connection: int) -> None:
        """Write registers."""
        self.memory.write(space, address, raw)

    def tick(self) -> None:
        """Nothing happens by itself."""

    def _cell(self, place: Register, read) -> None:
        self.memory.add(Cell(place, on_read=read, writable=False))


def partner(number: int) -> int:
    """Return the number that belongs to a reading's."""
    return number * 2654435761 % MODULUS


def reached(address: str, deadline_s: float) -> Access:
    """Return the way to a served device, as the driver takes it."""
    place, probe = parse_address(address), make_probe(TABLE)
    return Access(
        polled_link(place, unit=1, probe=probe),
        TABLE.model_copy(update={"deadline_s": deadline_s}),
        probe=None if place.is_numbered else probe,
        numbered=place.is_numbered,
    )


def campaign(
    wire: str, kind: FaultKind, faults: int, *, deadline_s: float | None = None, seed: int = 0
) -> Outcome:
    """Make faults of one kind until there were enough, and check every answer of the driver."""
    limit_s = deadline_s or DEADLINES_S[wire]
    framing = TcpFraming() if wire == "tcp" else RtuFraming(crc16)
    mangler = Mangler(kind, framing, share=0.0, seed=seed, late_s=LATE[wire] * limit_s)
    device = CountingDevice()
    places = [place_of(TABLE, channel) for channel in TABLE.channels]
    readings = wrong = writes = wrong_writes = failed = hopeless = calls = 0
    deadlines = Deadlines(limit_s)
    with ExitStack() as stack:
        address = stack.enter_context(behind(stack.enter_context(emulated(device, wire)), mangler))
        access = reached(address, limit_s)
        stack.callback(access.close)
        if TABLE.output is None:
            raise ValueError("the table has no output")
        outputs = Outputs(access, TABLE, TABLE.output)
        _open(access)
        mangler.share = SHARES[wire]
        while mangler.changed < faults and hopeless < HOPELESS:
            calls += 1
            before = device.count
            try:
                if calls % 4 == 0 or kind == "echo":
                    value = (calls % 2001 - 1000) * 0.001
                    # a write and its read-back: each has its deadline
                    with deadlines.call(2.0):
                        outputs.write(value)
                    writes += 1
                    wrong_writes += round(value * 1000) != device.output.value
                else:
                    with deadlines.call():
                        number, second = access.read(places)
                    readings += 1
                    wrong += not (number > before and second == partner(int(number)))
                hopeless = 0
            except (DeviceError, ProfileError):
                failed, hopeless = failed + 1, hopeless + 1
        mangler.share = 0.0
    counted = (mangler.changed, readings, wrong, writes, wrong_writes, failed)
    late = (deadlines.over, deadlines.held_up, round(deadlines.worst, 3))
    return Outcome(wire, kind, *counted, *late)


def _open(access: Access) -> None:
    """Ask who answers, as the driver does; every later connection is asked again."""
    for attempt in range(5):
        try:
            check_identity(access, TABLE)
        except DeviceError:
            if attempt == 4:
                raise
        else:
            return


def main() -> int:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--faults", type=int, default=10_000)
    parser.add_argument("--wire", choices=WIRES)
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--deadline-s", type=float, help="longest time of one call")
    asked = parser.parse_args()
    bad = 0
    for wire in WIRES if asked.wire is None else (asked.wire,):
        for kind in KINDS if asked.kind is None else (asked.kind,):
            if wire != "tcp" and kind in NUMBERED:
                continue
            outcome = campaign(wire, kind, asked.faults, deadline_s=asked.deadline_s)
            print(json.dumps(asdict(outcome)), flush=True)
            if (wire, kind) not in UNTOLD:
                bad += outcome.wrong_readings + outcome.wrong_writes
            bad += outcome.faults < asked.faults // 2
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
