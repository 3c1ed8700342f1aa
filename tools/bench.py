"""Table of speed: filter, simulated bench, trace files, list of runs, the command's start.

Usage: python tools/bench.py [--samples N] [--rows N] [--seconds S] [--folders N] [--write PAGE.md]

Ends 1 where the list of runs takes more than half of a walk that reads every run.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import bench_filter
import numpy as np

from hdbench import __version__
from hdbench.devices.node.registers import ALL_CHANNELS, block_scans
from hdbench.plant.bench import SimulatedBench
from hdbench.plant.plantfile import load_plant
from hdbench.profile import load_profile
from hdbench.records import Trace, read_trace, write_trace
from hdbench.records.runindex import INDEX_NAME, list_runs

PAGE = """# Speed

Written by `make bench`, which installs the libraries that stand beside hdbench. A shared computer
allows ratios only: all contenders take turns in one run, and processor time is counted. *times
ours* is the cost of a contender divided by that of hdbench. The matrices of other filters are made
beforehand and not counted; ours starts from velocity and torque.

{machine}

| what | cost | times ours | differs, N m |
|---|---|---|---|
{rows}
"""
Row = tuple[str, str, str, str]

_WALK, _LATER = "bare walk, reading every run", "list of runs, later"
_MOST_SHARE = 0.5
# longer than the coarsest clock of a file system: younger runs are read again
_SETTLE_S = 2.5
_COLUMNS = ("time_s", "motor_velocity_rad_s", "torque_nm", "motor_current_a", "reference_v")


def seconds(work: Callable[[], object], rounds: int = 3) -> float:
    """Return the least time of some rounds, s."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def files(rows: int) -> tuple[dict[str, float], dict[str, float]]:
    """Write and read a trace of six columns with everything that is here."""
    rng = np.random.default_rng(1)
    channels = {name: rng.normal(size=rows) for name in (*_COLUMNS, "motor_angle_rad")}
    channels["time_s"] = np.arange(rows) * 1e-3
    trace = Trace(channels, source="bench")
    matrix = np.stack(list(channels.values()), axis=1)
    with tempfile.TemporaryDirectory() as folder:
        path, other = Path(folder) / "trace.csv", Path(folder) / "other.csv"
        write = {"hdbench": lambda: write_trace(path, trace)}
        read: dict[str, Callable[[], object]] = {"hdbench": lambda: read_trace(path)}
        write["numpy"] = lambda: np.savetxt(other, matrix, delimiter=",")
        read["numpy"] = lambda: np.loadtxt(path, delimiter=",", skiprows=1)
        for name in ("pandas", "polars"):
            try:
                library = importlib.import_module(name)
            except ImportError:
                continue
            frame = library.DataFrame(channels)
            write[name] = (
                (lambda f=frame: f.to_csv(other, index=False))
                if name == "pandas"
                else (lambda f=frame: f.write_csv(other))
            )
            read[name] = lambda m=library: m.read_csv(path)
        written = {name: seconds(work, 1) for name, work in write.items()}
        taken = {name: seconds(work) for name, work in read.items()}
    return taken, written


def start() -> dict[str, float]:
    """Time `hdbench --help` against a bare click command."""
    bare = "import click; click.Command('x', help='y')(['--help'])"
    found = {}
    for name, arguments in (
        ("hdbench --help", ["-m", "hdbench_cli", "--help"]),
        ("bare click", ["-c", bare]),
        ("bare python", ["-c", "pass"]),
    ):
        command = [sys.executable, *arguments]
        found[name] = seconds(
            lambda c=command: subprocess.run(c, capture_output=True, check=True), 7
        )
    return found


def faster(plant: str, *, block: int, seconds: float, locked: bool) -> float:
    """Return simulated time over elapsed time."""
    profile = load_profile("cim-tr-97-06").data
    bench = SimulatedBench(profile, load_plant(plant), 1)
    bench.set_fixture(locked=locked, position_rad=0.0, mass_kg=4.0, direction=1)
    period_s = profile.calibration.sample_period_s if locked else profile.daq.sample_period_s
    wave = None if locked else profile.ripple.reference
    n_samples = round(seconds / period_s)
    started = time.perf_counter()
    bench.begin(sample_period_s=period_s, wave=wave, duration_s=seconds)
    for _ in range(0, n_samples, block):
        bench.advance(block)
    return seconds / (time.perf_counter() - started)


def plants(seconds: float) -> Iterator[tuple[str, float]]:
    """Yield how much faster than real time the simulated bench runs, on one core."""
    scans = block_scans(ALL_CHANNELS.bit_count())
    for plant in ("as-modelled", "worn"):
        # a sample, a block of the wire, which is what a host asks for while it watches, a second
        for block in (1, scans, 1000):
            found = faster(plant, block=block, seconds=seconds, locked=False)
            yield f"plant {plant}, 1 kHz, 5 channels, {block} at once", found
        found = faster(plant, block=scans, seconds=seconds, locked=True)
        yield f"plant {plant}, locked, 100 Hz, {scans} at once", found


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
        **dict.fromkeys(("trace.csv", "journal.hdj", "report.html"), ""),
    }
    for k in range(count):
        folder = parent / f"20261121T101500Z-ripple-{k:06x}"
        folder.mkdir()
        for name, text in texts.items():
            (folder / name).write_text(text)


def walk(parent: Path, *, reading: bool) -> None:
    """Name the files in every folder; with `reading` parse the two that the list tells of."""
    for place, _, files_there in os.walk(parent):
        for name in ("run.json", "result.json") if reading and "run.json" in files_there else ():
            json.loads((Path(place) / name).read_bytes())


def list_first(parent: Path) -> object:
    """List the runs without an index."""
    (parent / INDEX_NAME).unlink(missing_ok=True)
    return list_runs(parent)


def lists(count: int) -> dict[str, float]:
    """Return the processor time of the list of runs beside bare walks, ns a run."""
    works: dict[str, Callable[[Path], object]] = {
        _WALK: partial(walk, reading=True),
        "bare walk, naming files only": partial(walk, reading=False),
        "list of runs, first build": list_first,
        _LATER: list_runs,
    }
    with tempfile.TemporaryDirectory() as name:
        parent = Path(name)
        make_runs(parent, count)
        time.sleep(_SETTLE_S)
        return bench_filter.timed({what: (partial(w, parent), count) for what, w in works.items()})


def _row(name: str, cost: float, unit: str, against: float, differs: float | None) -> Row:
    took = "" if math.isnan(cost) else f"{cost:.4g} {unit}"
    ratio = "" if math.isnan(against) else f"{against:.3g}"
    return name, took, ratio, "" if differs is None else f"{differs:.1e}"


def _rows(samples: int, rows: int, simulated_s: float, listed: dict[str, float]) -> Iterator[Row]:
    """Yield the rows of the table, each when it is measured."""
    filters, missing = bench_filter.rows(samples)
    for row in filters:
        yield _row(row.name, row.cost, "ns per sample", row.against, row.differs_nm)
    for word, found in zip(("read", "write"), files(rows), strict=True):
        for name, cost in found.items():
            title = f"{word} CSV of {rows:.0e} x 6, {name}"
            yield _row(title, cost, "s", cost / found["hdbench"], None)
    for name, ratio in plants(simulated_s):
        yield name, f"{ratio:.0f} times real time", "", ""
    for name, cost in listed.items():
        yield _row(name, 1e-3 * cost, "us per run", cost / listed[_LATER], None)
    started = start()
    for name, cost in started.items():
        yield _row(name, 1e3 * cost, "ms", cost / started["hdbench --help"], None)
    for name in missing:
        yield name, "not here", "pip install 'hdbench[bench]'", ""


def _machine() -> str:
    found = Path("/proc/cpuinfo")
    names = re.findall(r"model name\s*: (.*)", found.read_text()) if found.is_file() else []
    chip = names[0] if names else platform.processor() or platform.machine()
    return f"{chip}, {platform.system()}, Python {platform.python_version()}, hdbench {__version__}"


def main() -> int:
    """Run everything, print it, and write the page where one is named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--samples", type=int, default=1_000_000, help="samples of the long run")
    parser.add_argument("--rows", type=int, default=1_000_000, help="rows of the trace file")
    parser.add_argument("--seconds", type=float, default=60.0, help="time to simulate, s")
    parser.add_argument("--folders", type=int, default=10_000, help="runs of the list")
    parser.add_argument("--write", metavar="FILE", type=Path, help="page to write")
    given = parser.parse_args()
    rows, listed = [], lists(max(given.folders, 1))
    print(f"{'':40} {'cost':24} {'times ours':>10} {'differs, N m':>13}")
    for row in _rows(max(given.samples, 1), max(given.rows, 1), given.seconds, listed):
        print(f"{row[0]:40} {row[1]:24} {row[2]:>10} {row[3]:>13}", flush=True)
        rows.append(f"| {' | '.join(row)} |")
    if given.write is not None:
        given.write.write_text(PAGE.format(machine=_machine(), rows="\n".join(rows)))
    return int(listed[_LATER] > _MOST_SHARE * listed[_WALK])


if __name__ == "__main__":
    sys.exit(main())
