"""A bench day in a folder: what the commands of the documentation work on."""

from __future__ import annotations

import json
import math
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import scipy.io

ROOT = Path(__file__).parents[2]
STORED = ROOT / "tests" / "stored"
# a header and some of the readings of a calibration, far from all of them
_SOME_READINGS_BYTES = 4096
OWN_CAUSE = """[[cause]]
name = "belt"
kind = "harmonics"
of = "motor"
order_range = [3.2, 3.6]
"""


@dataclass(frozen=True)
class Day:
    """The folder, and which of its runs stands for which word of the documentation."""

    folder: Path
    runs: dict[str, str]


def hdbench(
    folder: Path, *words: str, timeout_s: float = 240.0
) -> subprocess.CompletedProcess[str]:
    """Run one command as a user would, in `folder`."""
    return subprocess.run(
        [sys.executable, "-m", "hdbench_cli", *words],
        cwd=folder,
        env={**os.environ, "NO_COLOR": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


def _json(folder: Path, *words: str, allowed: tuple[int, ...] = (0,)) -> dict[str, object]:
    done = hdbench(folder, *words, "--json")
    assert done.returncode in allowed, f"{words}: {done.stdout}{done.stderr}"
    return json.loads(done.stdout)


def _run(folder: Path, *words: str) -> str:
    return str(_json(folder, *words, "--no-report", allowed=(0, 6))["run_folder"])


def _log(source: Path, target: Path) -> None:
    """Write a trace as another program might have: own names, semicolons left to importers."""
    head, *rows = source.read_text().splitlines()
    names = head.split(",")
    picked = [names.index(n) for n in ("time_s", "motor_velocity_rad_s", "torque_nm")]
    lines = ["Timestamp,speed,torque,t_ms,rpm,Torque"]
    for row in rows[:8000]:
        time, speed, torque = (float(row.split(",")[i]) for i in picked)
        cells = (time, speed, torque, 1000.0 * time, speed * 30.0 / math.pi, torque)
        lines.append(",".join(map(repr, cells)))
    target.write_text("\n".join(lines) + "\n")


def _array_files(source: Path, folder: Path) -> None:
    """Write the trace as MATLAB would, and the motion of its joint as a robot's program might."""
    data = np.genfromtxt(source, delimiter=",", names=True, max_rows=8000)
    at, velocity = data["time_s"], data["motor_velocity_rad_s"]
    angle = np.cumsum(velocity) * float(np.median(np.diff(at)))
    columns = {"time": at, "velocity": velocity, "torque": data["torque_nm"]}
    scipy.io.savemat(folder / "log.mat", columns)
    moved = {"t": at, "q_2": angle / 100.0, "qd_2": velocity / 100.0, "tau_2": data["torque_nm"]}
    np.savez(folder / "robot.npz", **moved)


def _logger_files(source: Path, folder: Path) -> None:
    """Write the trace as a stream file of one logger and an export of another."""
    head, *rows = source.read_text().splitlines()
    names = head.split(",")
    picked = [names.index(n) for n in ("time_s", "torque_v", "tacho_v")]
    cells = [[row.split(",")[i] for i in picked] for row in rows[:8000]]
    stream = ["11/21/2026", "10:15:00 AM", "Time\tv0\tv1", *map("\t".join, cells)]
    (folder / "stream_0.dat").write_text("\n".join(stream) + "\n")
    export = ['"Relative Time","Torque","Tacho"', '"sec","Volt","Volt"', *map(",".join, cells)]
    (folder / "windaq.csv").write_text("\n".join(export) + "\n")


def _staircases(folder: Path) -> None:
    """Write raw readings under changing weights: one with names, one of eleven nameless columns."""
    spread = random.Random(1)
    for name, head, levels in (
        ("weights.csv", "t_ms,counts\n", (0, 1, 2, 1, 0)),
        ("cell.csv", "", (0, 10, 20, 30, 40, 30, 20, 10, 0)),
    ):
        rows = []
        for k, level in enumerate(level for level in levels for _ in range(80)):
            cells = [str(100 * k), f"{0.1 * level + spread.gauss(0.0, 0.002):.5f}"]
            rows.append(",".join(cells if head else [cells[0], *["0"] * 9, cells[1]]))
        (folder / name).write_text(head + "\n".join(rows) + "\n")


def _interrupted(folder: Path) -> str:
    """Stop a calibration on its way, and return its run: it can be resumed."""
    words = [sys.executable, "-m", "hdbench_cli", "calibrate", "--no-input", "--out", "stopped"]
    with subprocess.Popen(
        words, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        deadline = time.monotonic() + 120.0
        # a journal of some readings; a whole one has about 80
        while process.poll() is None and time.monotonic() < deadline:
            sizes = [file.stat().st_size for file in folder.glob("stopped/*/journal.hdj")]
            if max(sizes, default=0) > _SOME_READINGS_BYTES:
                process.send_signal(signal.SIGINT)
                break
            time.sleep(0.02)
    (run,) = (folder / "stopped").iterdir()
    kept = folder / "runs" / run.name
    kept.parent.mkdir(exist_ok=True)
    run.rename(kept)
    return str(kept.relative_to(folder))


def _build(folder: Path) -> dict[str, str]:
    # first, so that it is nobody's last run
    stopped = _interrupted(folder)
    calibration = _run(folder, "calibrate", "--no-input")
    again = _run(folder, "calibrate", "--no-input", "--seed", "1")
    short = folder / "short.toml"
    text = (ROOT / "profiles" / "cim-tr-97-06.toml").read_text()
    # one period of the reference is enough for every command
    short.write_text(re.sub(r"(\[ripple\]\nduration_s = )[\d.]+", r"\g<1>16.0", text))
    misalignment = _run(folder, "run-misalignment", "--yes", "--calibration", calibration)
    ripple_run = ("run-ripple", "--yes", "--profile", "short.toml")
    ripple = _run(folder, *ripple_run, "--plant", "worn", "--seed", "1")
    other = _run(folder, *ripple_run, "--seed", "2")
    diagnosis = _json(folder, "diagnose", ripple, allowed=(0, 6))
    found = str(diagnosis["run_folder"])
    for name, run in (("trace.csv", ripple), ("other.csv", other)):
        shutil.copy(folder / run / "trace.csv", folder / name)
    shutil.copy(folder / calibration / "loads.csv", folder / "loads.csv")
    shutil.copy(folder / found / "model.json", folder / "extended.json")
    _log(folder / ripple / "trace.csv", folder / "log.csv")
    _logger_files(folder / ripple / "trace.csv", folder)
    _array_files(folder / ripple / "trace.csv", folder)
    (folder / "own.toml").write_text(OWN_CAUSE)
    shutil.copytree(STORED, folder / "tests" / "stored")
    _json(folder, "profile", "new", "my-bench", "--out", "my-bench.toml")
    shutil.copy(folder / "my-bench.toml", folder / "robot.toml")
    _json(folder, "tune", other, "--out", "tuned.json")
    _json(folder, "plan", "--cause", "ripple-harmonic", "--no-loads", "--out", "plan.toml")
    _staircases(folder)
    return {
        "stopped": stopped,
        "calibration": calibration,
        "again": again,
        "misalignment": misalignment,
        "ripple": ripple,
        "other": other,
        "diagnosis": found,
    }


@pytest.fixture(scope="session")
def day(tmp_path_factory: pytest.TempPathFactory) -> Day:
    """Build the folder once for all processes of the test run."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base
    folder, ready = shared / "bench-day", shared / "bench-day.json"
    try:
        folder.mkdir()
    except FileExistsError:
        # a day takes half a minute on a machine of its own, ten on one that is shared by many
        deadline = time.monotonic() + 900.0
        while not ready.exists():
            assert time.monotonic() < deadline, "the other process did not finish the bench day"
            time.sleep(0.2)
    else:
        runs: dict[str, str] = {}
        try:
            runs = _build(folder)
        finally:  # the others wait for it, also where it has failed
            _tell(ready, runs)
    runs = json.loads(ready.read_text())
    assert runs, "the bench day could not be built"
    return Day(folder, runs)


def _tell(ready: Path, runs: dict[str, str]) -> None:
    staged = ready.with_suffix(".tmp")
    staged.write_text(json.dumps(runs))
    staged.rename(ready)
