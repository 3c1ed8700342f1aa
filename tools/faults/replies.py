"""Wrong, stale, duplicate, reordered and mutated replies between the driver and a node.

Usage: python tools/faults/replies.py [--faults 10000] [--wire tcp|rtu] [--kind KIND] [--seed N]

Every sample that the driver hands out is compared with what the node sampled at its index. A line
per wire and kind: faults made, samples delivered, wrong and lost ones, calls that failed, the worst
time of a call over its deadline.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from faults.lines import Deadlines, behind, emulated
from faults.mangler import FaultKind, Mangler, RtuFraming, TcpFraming
from hdbench.devices.daq import DaqSettings, ScanBlock
from hdbench.devices.emulator.node import build_core
from hdbench.devices.emulator.server import Wire
from hdbench.devices.node.driver import NodeDaq, open_node
from hdbench.devices.wire.rtu import crc16
from hdbench.errors import DeviceError
from hdbench.plant.converter import RawSamples
from hdbench.profile import load_profile

__all__ = ["KINDS", "Outcome", "campaign"]

# the five of the campaign; "wrong" goes through these in turn
WRONG: tuple[FaultKind, ...] = ("function", "count", "unit", "exception", "truncate", "garbage")
KINDS: dict[str, tuple[FaultKind, ...]] = {
    "wrong": WRONG,
    "stale": ("stale",),
    "duplicate": ("duplicate",),
    "reordered": ("reorder",),
    "mutated": ("mutate",),
    "noise": ("noise",),
}
PROFILE = load_profile("cim-tr-97-06").data
ROLES = ("torque", "tacho", "current", "reference", "encoder")
# one reply in three: most calls still succeed at their second try
SHARE = 0.3
# a call that fails is made again; so many in a row mean that nothing works any more
HOPELESS = 50
# after so many the device may hold its host for gone, and has ended the acquisition
GONE = 5


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one campaign.

    Parameters
    ----------
    wire, kind : str
        ``tcp`` or ``rtu``, and the fault.
    faults, replies : int
        Replies changed, and all of them.
    delivered, wrong, lost : int
        Samples handed out, those that were not what the node sampled, and those told as lost.
    failed_calls : int
        Calls that ended with an error, every one within its deadline.
    calls_over, held_up : int
        Calls of more than 1.1 deadlines, and those among them for want of a processor.
    worst_over_deadline : float
        Longest call over its deadline, 1.
    """

    wire: str
    kind: str
    faults: int
    replies: int
    delivered: int
    wrong: int
    lost: int
    failed_calls: int
    calls_over: int
    held_up: int
    worst_over_deadline: float


class CountingBench:
    """A bench whose sample k tells k in every channel."""

    reference_v = velocity_rad_s = 0.0
    enabled = False

    def __init__(self) -> None:
        self._next = 0

    def begin(self, **_: object) -> None:
        """Count from zero."""
        self._next = 0

    def halt(self) -> None:
        """Nothing moves."""

    def advance(self, n_samples: int) -> RawSamples:
        """Return the next samples."""
        index = np.arange(self._next, self._next + n_samples)
        self._next += n_samples
        return RawSamples(*codes_of(index))

    def set_fixture(self, **_: object) -> None:
        """Nothing to set."""

    def set_handling(self, **_: object) -> None:
        """Nothing to set."""


def codes_of(index: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return what `CountingBench` samples at `index`: four codes and the encoder."""
    code = (index * 7919 % 30011).astype(np.int16)
    return code, -code, (code // 3).astype(np.int16), (index % 29989).astype(np.int16), index * 201


def wrong_samples(block: ScanBlock) -> int:
    """Return how many scans of a block are not those of their index."""
    index = block.first_index + np.arange(len(block))
    torque, tacho, current, reference, encoder = codes_of(index)
    volts, amperes = PROFILE.daq.range_v / 32768, PROFILE.servo.max_current_a / 32768
    expected = np.column_stack(
        (torque * volts, tacho * volts, current * amperes, reference * volts, encoder)
    )
    return int(np.count_nonzero(np.any(block.values != expected, axis=1)))


def served(wire: Wire) -> AbstractContextManager[str]:
    """Serve a counting node in a thread; yields its address."""
    return emulated(build_core(CountingBench(), PROFILE, 0, pace="fast"), wire)


def campaign(
    wire: str, kind: str, faults: int, *, deadline_s: float | None = None, seed: int = 0
) -> Outcome:
    """Make faults of one kind until there were enough, and hold every sample against the node's."""
    limit_s = deadline_s or (0.4 if wire == "rtu" else 0.06)
    parts = [part(wire, one, faults // len(KINDS[kind]) or 1, limit_s, seed) for one in KINDS[kind]]
    return Outcome(
        wire,
        kind,
        *(sum(part[n] for part in parts) for n in range(8)),
        round(max(part[8] for part in parts), 3),
    )


def part(
    wire: str, kind: FaultKind, faults: int, deadline_s: float, seed: int
) -> tuple[int, int, int, int, int, int, int, int, float]:
    """Make faults of one kind; return the counts of `Outcome`, from `faults` on, in their order."""
    framing = RtuFraming(crc16) if wire == "rtu" else TcpFraming()
    mangler = Mangler(kind, framing, share=0.0, seed=seed)
    delivered = wrong = lost = failed = hopeless = 0
    deadlines = Deadlines(deadline_s)
    with ExitStack() as stack:
        node = stack.enter_context(served(wire))
        address = stack.enter_context(behind(node, mangler))
        table = PROFILE.daq.model_copy(update={"address": address, "deadline_s": deadline_s})
        daq = open_node(PROFILE, table)
        stack.callback(daq.close)
        _begin(daq)
        mangler.share = SHARE
        while mangler.changed < faults and hopeless < HOPELESS:
            try:
                with deadlines.call():
                    block = daq.read_block()
                hopeless = 0
            except DeviceError:
                block = None
                failed, hopeless = failed + 1, hopeless + 1
                if hopeless % GONE == 0:
                    mangler.share = 0.0
                    _begin(daq)
                    mangler.share = SHARE
            if block is not None:
                delivered += len(block)
                wrong += wrong_samples(block)
                lost += block.lost_before
        mangler.share = 0.0
    counted = (mangler.changed, mangler.seen, delivered, wrong, lost, failed)
    return *counted, deadlines.over, deadlines.held_up, deadlines.worst


def _begin(daq: NodeDaq) -> None:
    """Start the acquisition; on a busy machine a short deadline may take several tries."""
    for last in (False,) * (HOPELESS - 1) + (True,):
        try:
            daq.configure(DaqSettings(ROLES, 1e-3, 100_000_000, 2.0))
            daq.start()
            return
        except DeviceError:
            daq.safe_state()
            if last:
                raise


def main() -> int:
    """Run what is asked for; 0 where no wrong sample came through."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--faults", type=int, default=10_000)
    parser.add_argument("--wire", choices=["tcp", "rtu"])
    parser.add_argument("--kind", choices=[*KINDS])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--deadline-s", type=float, help="longest time of one call")
    parser.add_argument("--serve", choices=["tcp", "rtu"], help="only serve the counting node")
    asked = parser.parse_args()
    if asked.serve:
        with served(asked.serve) as address:
            print(json.dumps({"address": address}), flush=True)
            signal.sigwait((signal.SIGTERM, signal.SIGINT))
        return 0
    bad = 0
    for wire in ("tcp", "rtu") if asked.wire is None else (asked.wire,):
        for kind in KINDS if asked.kind is None else (asked.kind,):
            outcome = campaign(
                wire, kind, asked.faults, deadline_s=asked.deadline_s, seed=asked.seed
            )
            print(json.dumps(asdict(outcome)), flush=True)
            bad += outcome.wrong + outcome.lost + (outcome.faults < asked.faults // 2)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
