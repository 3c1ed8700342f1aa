"""Hours of samples at 1 kHz in five channels, faster than they would take: none missing, no growth.

Usage: python tools/faults/soak.py [--hours 8] [--keep FOLDER]

A node that counts (sample k tells k in every channel) is read over Modbus TCP as fast as it goes,
by the driver, the recorder with its online filter and the journal of a run; then every sample in
the journal is held against the node's own. Prints samples, rows, wrong and missing ones, and the
memory of the process in every tenth.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from faults import replies
from hdbench.devices.bench import AcquisitionSettings
from hdbench.devices.feasibility import host_settings
from hdbench.devices.host.bench import HostedBench
from hdbench.devices.node.driver import open_node
from hdbench.filter import preset
from hdbench.records.counted import survey_samples
from hdbench.records.journal import JournalReader, JournalWriter
from hdbench.session.recorder import TraceRecorder

PERIOD_S = 1e-3
TENTHS = 10


def memory_mib() -> float:
    """Return the memory that this process has now, MiB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def record(address: str, path: Path, n_samples: int) -> tuple[TraceRecorder, list[float]]:
    """Record `n_samples` into a journal; return the recorder and the memory in every tenth, MiB."""
    profile = replies.PROFILE
    table = profile.daq.model_copy(update={"address": address, "deadline_s": 1.0})
    memory: list[float] = []
    with JournalWriter(path) as journal:
        model = preset("report-6", profile)
        recorder = TraceRecorder(profile, 6.6, model, journal, PERIOD_S)
        bench = HostedBench(open_node(profile, table), host_settings(profile, watchdog_s=2.0))
        try:
            bench.claim()
            bench.configure(AcquisitionSettings(PERIOD_S, n_samples, None))
            recorder.begin(None)
            bench.start()
            while recorder.n_rows < n_samples:
                block = bench.read_block()
                if block is not None and (len(block) or block.lost_before):
                    recorder.add(block)
                if recorder.n_rows >= n_samples * (len(memory) + 1) / TENTHS:
                    memory.append(round(memory_mib(), 1))
            bench.stop()
            bench.safe_state()
        finally:
            bench.close()
    return recorder, memory


def check(path: Path, n_samples: int) -> tuple[int, int]:
    """Return samples in the journal, and how many are missing or not what the node sampled."""
    volts = replies.PROFILE.daq.range_v / 32768
    rows = wrong = 0
    for block in JournalReader(path):
        if block.kind != "samples":
            continue
        found = block.columns
        index = np.arange(rows, rows + len(found["time_s"]))
        torque, tacho, _, _, encoder = replies.codes_of(index)
        # the counter of the node is of 32 bits; the adapter has unwrapped it
        good = (
            (found["torque_v"] == torque * volts)
            & (found["tacho_v"] == tacho * volts)
            & (found["time_s"] == index * PERIOD_S)
            & (found["encoder_count"] == encoder)
        )
        wrong += int(np.count_nonzero(~good))
        rows += len(index)
    return rows, wrong + abs(rows - n_samples)


def main() -> int:
    """Run the soak; 0 where nothing was missing and the memory did not grow."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=8.0, help="of samples at 1 kHz")
    parser.add_argument("--keep", type=Path, help="folder for journal and trace")
    parser.add_argument("--trace", action="store_true", help="write the trace, too: 6 GB")
    asked = parser.parse_args()
    n_samples = round(asked.hours * 3600 / PERIOD_S)
    # a node in a process of its own, so that it does not wait for the one that records
    serve = [sys.executable, replies.__file__, "--serve", "tcp"]
    process = subprocess.Popen(serve, stdout=subprocess.PIPE, text=True)
    try:
        if process.stdout is None:
            raise RuntimeError("no pipe")
        address = json.loads(process.stdout.readline())["address"]
        with tempfile.TemporaryDirectory(prefix="hdbench-soak-") as temporary:
            folder = asked.keep or Path(temporary)
            folder.mkdir(parents=True, exist_ok=True)
            start_s = time.monotonic()
            recorder, memory = record(address, folder / "journal.hdj", n_samples)
            recorded_s = time.monotonic() - start_s
            rows, wrong = check(folder / "journal.hdj", n_samples)
            if asked.trace:
                survey_samples(folder / "journal.hdj").write(folder / "trace.csv")
            after_mib = round(memory_mib(), 1)
    finally:
        process.terminate()
        process.wait(10)
    grown_mib = memory[-1] - memory[0]
    result = {
        "hours": asked.hours,
        "samples": n_samples,
        "lost": recorder.lost,
        "rows": rows,
        "wrong_or_missing": wrong,
        "recorded_in_s": round(recorded_s, 1),
        "memory_mib_in_every_tenth": memory,
        "memory_mib_at_the_end": after_mib,
    }
    print(json.dumps(result), flush=True)
    # a few arrays of one block; anything kept per sample would be hundreds of MiB
    return int(bool(recorder.lost or wrong or rows != n_samples or grown_mib > 5.0))


if __name__ == "__main__":
    sys.exit(main())
