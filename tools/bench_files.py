"""Time trace files and the start of the command, beside other libraries; see `tools/bench.py`."""

from __future__ import annotations

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
