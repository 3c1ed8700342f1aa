"""Time of the list of runs, first and later, beside bare walks of the same folders, in one run.

    python tools/bench_index.py --folders 10000

Two bare walks: one that reads every run's record as the list would without an index, and one that
only names the files in every folder and so sees no change in them.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from hdbench.profile import load_profile
from hdbench.records.runindex import list_runs, read_run

_REPEATS = 5
# longer than the coarsest clock of a file system: younger runs are read again
_SETTLE_S = 2.5


def make_runs(parent: Path, count: int) -> None:
    """Write run folders as an experiment leaves them, with small files for the large ones."""
    profile = load_profile("cim-tr-97-06")
    run = {
        "schema": "hdbench/run/1",
        "kind": "ripple",
        "status": "complete",
        "started_utc": "2026-11-21T10:15:00.000000Z",
        "profile": {"name": profile.name, "sha256": profile.sha256, "text": profile.text},
        "files": {"trace.csv": "0" * 64, "result.json": "0" * 64},
        "drive": "A-17",
    }
    texts = {
        "run.json": json.dumps(run, indent=2),
        "result.json": json.dumps({"schema": "hdbench/ripple/1", "doubts": [], "flags": []}),
        "trace.csv": "",
        "journal.hdj": "",
        "report.html": "",
    }
    for k in range(count):
        folder = parent / f"20261121T101500Z-ripple-{k:06x}"
        folder.mkdir()
        for name, text in texts.items():
            (folder / name).write_text(text)


def seconds(work: Callable[[], object], repeats: int = _REPEATS) -> float:
    """Return the shortest time of several."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> int:
    """Print the times and their ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folders", type=int, default=10_000)
    count = parser.parse_args().folders
    with tempfile.TemporaryDirectory() as name:
        parent = Path(name)
        make_runs(parent, count)
        time.sleep(_SETTLE_S)
        reading = seconds(lambda: [read_run(path) for path in parent.iterdir()])
        naming = seconds(lambda: sum(len(files) for _, _, files in os.walk(parent)))
        first = seconds(lambda: list_runs(parent), repeats=1)
        later = seconds(lambda: list_runs(parent))
    for what, value in (
        ("bare walk, reading every run", reading),
        ("bare walk, naming files only", naming),
        ("list of runs, first build", first),
        ("list of runs, later", later),
    ):
        print(f"{what:32}{value:8.3f} s  {value / reading:6.2f} of the reading walk")
    return 0


if __name__ == "__main__":
    sys.exit(main())
