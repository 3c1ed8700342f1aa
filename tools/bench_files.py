"""Print how long trace files and the start of the command take, beside other libraries.

Usage: python tools/bench_files.py [--rows N]
"""

from __future__ import annotations

import argparse
import importlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hdbench.records import Trace, read_trace, write_trace

_COLUMNS = ("time_s", "motor_velocity_rad_s", "torque_nm", "motor_current_a", "reference_v")


def seconds(work: Callable[[], object], rounds: int = 3) -> float:
    """Return the least time of some rounds, s.

    Parameters
    ----------
    work : callable
        What to time.
    rounds : int
        How often.

    Returns
    -------
    float
        Seconds.
    """
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def files(rows: int) -> None:
    """Write and read a trace of six columns with everything that is here.

    Parameters
    ----------
    rows : int
        Number of samples.
    """
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
                print(f"{name}: not here; pip install 'hdbench[bench]'")
                continue
            frame = library.DataFrame(channels)
            write[name] = (
                (lambda f=frame: f.to_csv(other, index=False))
                if name == "pandas"
                else (lambda f=frame: f.write_csv(other))
            )
            read[name] = lambda m=library: m.read_csv(path)
        written = {name: seconds(work, 1) for name, work in write.items()}
        size = path.stat().st_size / 1e6
        taken = {name: seconds(work) for name, work in read.items()}
    print(
        f"CSV of {rows} x 6, {size:.0f} MB: "
        f"{'read s':>10} {'times':>7} {'write s':>10} {'times':>7}"
    )
    for name, value in taken.items():
        print(
            f"{name:>28} {value:10.3f} {value / taken['hdbench']:7.2f} {written[name]:10.3f} "
            f"{written[name] / written['hdbench']:7.2f}"
        )
    best = [min(table, key=table.__getitem__) for table in (taken, written)]
    print(f"fastest: {best[0]} reads, {best[1]} writes")


def start() -> None:
    """Time `hdbench --help` against a bare click command."""
    bare = "import click; click.Command('x', help='y')(['--help'])"
    for name, arguments in (
        ("hdbench --help", ["-m", "hdbench_cli", "--help"]),
        ("bare click", ["-c", bare]),
        ("bare python", ["-c", "pass"]),
    ):
        command = [sys.executable, *arguments]
        took = seconds(lambda c=command: subprocess.run(c, capture_output=True, check=True), 7)
        print(f"{name:>28} {1e3 * took:10.0f} ms")


def main() -> None:
    """Time files and the command's start."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rows", type=int, default=1_000_000)
    files(max(parser.parse_args().rows, 1))
    start()


if __name__ == "__main__":
    main()
