"""Table of speed: filter, simulated bench, trace files and the command's start.

Usage: python tools/bench.py [--samples N] [--rows N] [--seconds S] [--write PAGE.md]
"""

from __future__ import annotations

import argparse
import importlib
import math
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import bench_filter
import numpy as np

from hdbench import __version__
from hdbench.devices.node.registers import ALL_CHANNELS, block_scans
from hdbench.plant.bench import SimulatedBench
from hdbench.plant.plantfile import load_plant
from hdbench.profile import load_profile
from hdbench.records import Trace, read_trace, write_trace

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


def _row(name: str, cost: float, unit: str, against: float, differs: float | None) -> Row:
    took = "" if math.isnan(cost) else f"{cost:.4g} {unit}"
    ratio = "" if math.isnan(against) else f"{against:.3g}"
    return name, took, ratio, "" if differs is None else f"{differs:.1e}"


def _rows(samples: int, rows: int, simulated_s: float) -> Iterator[Row]:
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


def main() -> None:
    """Run everything, print it, and write the page where one is named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--samples", type=int, default=1_000_000, help="samples of the long run")
    parser.add_argument("--rows", type=int, default=1_000_000, help="rows of the trace file")
    parser.add_argument("--seconds", type=float, default=60.0, help="time to simulate, s")
    parser.add_argument("--write", metavar="FILE", type=Path, help="page to write")
    given = parser.parse_args()
    rows = []
    print(f"{'':40} {'cost':24} {'times ours':>10} {'differs, N m':>13}")
    for row in _rows(max(given.samples, 1), max(given.rows, 1), given.seconds):
        print(f"{row[0]:40} {row[1]:24} {row[2]:>10} {row[3]:>13}", flush=True)
        rows.append(f"| {' | '.join(row)} |")
    if given.write is not None:
        given.write.write_text(PAGE.format(machine=_machine(), rows="\n".join(rows)))


if __name__ == "__main__":
    main()
