"""Count what the LabJack driver delivers when its wire misbehaves, fault by fault.

Run: python tools/faults/labjack.py [TRIALS]

The stream part makes streams of eight packets in memory, spoils one of them in every trial, and
compares each scan that comes out with the one that went in. The control part sends reads to an
emulated device through a proxy that spoils half of the replies. One line per fault: trials, wrong
scans or values delivered, trials that ended with an error, scans told as lost.
"""

from __future__ import annotations

import struct
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from faults.lines import faulty_tcp
from faults.mangler import FAULT_KINDS, PACKET_FAULTS, Mangler, Spoil, TcpFraming, flipped
from hdbench.devices.wire.address import parse_address
from hdbench.devices.wire.link import connect
from hdbench.drivers.labjack.control import Control
from hdbench.drivers.labjack.registers import IDENTITY, TEST
from hdbench.drivers.labjack.scanlist import StreamSetup
from hdbench.drivers.labjack.stream import PacketParser, ScanAssembler, StreamFault
from hdbench.errors import DeviceError

SCANS, PACKETS = 20, 8
DEADLINE_S = 0.05
# Modbus TCP has no checksum: other values are well formed. A read has no echo
UNTOLD = ("mutate", "header", "noise", "word-swap", "echo", "slow-loris")


def packet(number: int, words: np.ndarray) -> bytes:
    """Return a stream packet."""
    data = words.astype(">u2").tobytes()
    return struct.pack(">HHHBBBBHHH", number, 0, 10 + len(data), 1, 76, 16, 0, 0, 0, 0) + data


def stream(random: np.random.Generator) -> tuple[list[bytes], np.ndarray]:
    """Return packets and the words in them."""
    words = random.integers(0, 65_000, (SCANS * PACKETS, 4))
    ticks = 1000 + 40_000 * np.arange(SCANS * PACKETS)
    words[:, 2], words[:, 3] = ticks & 0xFFFF, ticks >> 16
    return [packet(n, words[SCANS * n : SCANS * (n + 1)]) for n in range(PACKETS)], words


STREAM_FAULTS: dict[str, Spoil] = {
    **PACKET_FAULTS,
    "bit of the header": lambda p, n, r: [
        *p[:n],
        flipped(p[n][:16], 0, r) + p[n][16:],
        *p[n + 1 :],
    ],
    "bit of a sample": lambda p, n, r: [*p[:n], flipped(p[n], 16, r), *p[n + 1 :]],
}


def _delivered(packets: list[bytes], random: np.random.Generator) -> tuple[list[tuple], bool]:
    """Return runs and whether an error was told."""
    parser, scans = PacketParser(4 * SCANS), ScanAssembler(4, 2, StreamSetup(1e-3, 4 * SCANS))
    data = b"".join(packets)
    cut = int(random.integers(1, len(data)))
    runs: list[tuple] = []
    for part in (data[:cut], data[cut:]):
        try:
            for each in parser.feed(part):
                runs += [(r.first_index, r.lost_before, r.words) for r in scans.take(each)]
        except StreamFault:
            return runs, True
    return runs, False


def stream_campaign(trials: int) -> None:
    """Print one line per stream fault."""
    print("stream: fault, trials, wrong scans, of them one value, errors told, scans told lost")
    for name, spoil in STREAM_FAULTS.items():
        random = np.random.default_rng(1)
        wrong = single = errors = lost = 0
        for _ in range(trials):
            packets, true = stream(random)
            runs, told = _delivered(spoil(packets, int(random.integers(2, 6)), random), random)
            errors += told
            for first, missing, words in runs:
                lost += missing
                differs = np.count_nonzero(words != true[first : first + len(words)], axis=1)
                wrong += int(np.count_nonzero(differs))
                single += int(np.count_nonzero(differs == 1))
        print(f"  {name:22s} {trials:7d} {wrong:7d} {single:7d} {errors:7d} {lost:7d}")


def control_campaign(host: str, port: int, serial: int, trials: int) -> None:
    """Print one line per fault of the control port."""
    print(
        "control: fault, reads, wrong values, errors told, replies spoilt, longest call / deadline"
    )
    for kind in FAULT_KINDS:
        if kind in UNTOLD:
            continue
        mangler = Mangler(kind, TcpFraming(), share=0.5, seed=1, late_s=1.5 * DEADLINE_S)
        wrong = errors = 0
        longest_s = 0.0
        with faulty_tcp(host, port, mangler) as near:
            address = parse_address(f"tcp://{near[0]}:{near[1]}")
            control = Control(connect(address), deadline_s=DEADLINE_S)
            for _ in range(trials):
                start_s = time.monotonic()
                try:
                    wrong += control.read(TEST, IDENTITY[3]) != [0x00112233, serial]
                except DeviceError:
                    errors += 1
                longest_s = max(longest_s, time.monotonic() - start_s)
            control.close()
        ratio = longest_s / DEADLINE_S
        print(f"  {kind:22s} {trials:7d} {wrong:7d} {errors:7d} {mangler.changed:7d} {ratio:9.2f}")


def main() -> int:
    """Run both parts."""
    from hdbench.devices.emulator.process import running_emulator
    from hdbench.profile import load_profile

    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    stream_campaign(trials)
    profile = load_profile("labjack-t7").data
    with running_emulator(profile, plant="as-modelled", seed=3, pace="realtime") as found:
        address = parse_address(str(found["address"]))
        control_campaign(address.host, address.port, 4, max(1, trials // 10))
    return 0


if __name__ == "__main__":
    sys.exit(main())
