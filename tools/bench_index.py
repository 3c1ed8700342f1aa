"""Time of the list of runs, first and later, beside bare walks of the same folders, in one run.

    python tools/bench_index.py --folders 10000

Two bare walks: one that parses the two files of every folder that the list tells of, run.json
and result.json, and one that only names the files in every folder and so sees no change in them.
The four take turns; of each the shortest time counts, as wall time and as time of the processor.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from hdbench.profile import load_profile
from hdbench.records.runindex import INDEX_NAME, list_runs

_REPEATS = 5
_MOST_SHARE = 0.5
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


def walk_reading(parent: Path) -> list[tuple[Any, Any]]:
    """Read what the list tells of every run, and do nothing with it."""
    return [
        tuple(json.loads((Path(place) / name).read_bytes()) for name in ("run.json", "result.json"))
        for place, _, files in os.walk(parent)
        if "run.json" in files
    ]


def walk_naming(parent: Path) -> int:
    """Count the files."""
    return sum(len(files) for _, _, files in os.walk(parent))


def list_first(parent: Path) -> object:
    """List the runs without an index."""
    (parent / INDEX_NAME).unlink(missing_ok=True)
    return list_runs(parent)


def main() -> int:
    """Print the times and their ratios; return 1 where later calls take over half of a walk."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folders", type=int, default=10_000)
    count = parser.parse_args().folders
    works = {
        "bare walk, reading every run": walk_reading,
        "bare walk, naming files only": walk_naming,
        "list of runs, first build": list_first,
        "list of runs, later": list_runs,
    }
    wall = dict.fromkeys(works, math.inf)
    cpu = dict(wall)
    with tempfile.TemporaryDirectory() as name:
        parent = Path(name)
        make_runs(parent, count)
        time.sleep(_SETTLE_S)
        for _ in range(_REPEATS):
            for what, work in works.items():
                wall_s, cpu_s = time.perf_counter(), time.process_time()
                work(parent)
                wall[what] = min(wall[what], time.perf_counter() - wall_s)
                cpu[what] = min(cpu[what], time.process_time() - cpu_s)
    walk, *_, later = works
    print(f"{count:<32}{'wall, s':>9}{'cpu, s':>9}   share of the reading walk: wall, cpu")
    for what in works:
        shares = f"{wall[what] / wall[walk]:6.2f}{cpu[what] / cpu[walk]:6.2f}"
        print(f"{what:32}{wall[what]:9.3f}{cpu[what]:9.3f}   {shares}")
    return int(cpu[later] > _MOST_SHARE * cpu[walk])


if __name__ == "__main__":
    sys.exit(main())
