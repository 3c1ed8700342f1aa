"""Count what the DATAQ driver delivers when its stream is spoilt, fault by fault.

Usage: python tools/faults/dataq.py [TRIALS]

Streams of twelve packets are made in memory, one fault is put into each, and every scan that comes
out is compared with the one that went in. One line per fault: trials, trials in which a wrong scan
came out, wrong scans, trials that ended with an error. Five words of a scan and packets of 128
bytes, as in the profile di-2108-ek9000; a whole number of scans that vanishes or comes twice is
found by the clock later, or not at all, and is listed apart.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from faults.mangler import PACKET_FAULTS, Spoil, flipped
from hdbench.drivers.dataq.scans import ScanAssembler, StreamFault, plan_scan
from hdbench.drivers.dataq.table import DataqAcquisition

__all__ = ["FAULTS", "campaign"]

ROLES = ("torque", "tacho", "current", "reference")
PACKET = 128
PACKETS = 12
MARK = 0x7F00
TABLE = DataqAcquisition.model_validate(
    {
        "driver": "dataq",
        "model": "DI-2108",
        "sample_period_s": 0.001,
        "channels": tuple(
            {"role": role, "input": f"analog {number}"} for number, role in enumerate(ROLES)
        ),
    }
)
PLAN = plan_scan(TABLE, ROLES)


def stream(random: np.random.Generator) -> tuple[list[bytes], np.ndarray]:
    """Return packets and the scans in them: any analog words, the mark at the end of each scan."""
    count = PACKET * PACKETS // PLAN.scan_bytes + 1
    words = random.integers(-32768, 32768, (count, len(PLAN.words))).astype("<i2")
    words[:, -1] = MARK
    data = words.tobytes()[: PACKET * PACKETS]
    return [data[at : at + PACKET] for at in range(0, len(data), PACKET)], words


FAULTS: dict[str, Spoil] = {
    **PACKET_FAULTS,
    "text in between": lambda p, n, r: [*p[:n], b"stop 01\r", *p[n:]],
    "five packets dropped": lambda p, n, r: p[:n] + p[n + 5 :],
    "bit of a sample": lambda p, n, r: [*p[:n], flipped(p[n], 0, r), *p[n + 1 :]],
}


def campaign(name: str, trials: int, seed: int = 1) -> dict[str, object]:
    """Spoil so many streams."""
    random = np.random.default_rng(seed)
    wrong_trials = wrong = errors = 0
    for _ in range(trials):
        packets, true = stream(random)
        spoilt = FAULTS[name](packets, int(random.integers(2, 6)), random)
        scans, told = _delivered(spoilt)
        differs = np.any(scans != true[: len(scans)], axis=1)
        wrong_trials += bool(np.any(differs))
        wrong += int(np.count_nonzero(differs))
        errors += told
    return {
        "fault": name,
        "trials": trials,
        "trials_wrong": wrong_trials,
        "wrong_scans": wrong,
        "errors": errors,
    }


def _delivered(packets: list[bytes]) -> tuple[np.ndarray, bool]:
    """Return the scans that come out, and whether an error was told."""
    assembler = ScanAssembler(PLAN)
    found = [np.zeros((0, len(PLAN.words)), dtype=np.int16)]
    try:
        found += [assembler.take(packet) for packet in [*packets, b""]]
    except StreamFault:
        return np.concatenate(found), True
    return np.concatenate(found), False


def main() -> int:
    """Run all faults."""
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    for name in FAULTS:
        print(json.dumps(campaign(name, trials)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
