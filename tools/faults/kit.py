"""Kit of the fault campaign: a served bench, runs in processes of their own, rows."""

from __future__ import annotations

import json
import mmap
import os
import re
import resource
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

__all__ = [
    "Row",
    "Run",
    "ServedBench",
    "acknowledging",
    "begin",
    "in_time",
    "served",
    "short_profile",
]

# half a rad/s: what counts as standing everywhere in hdbench
STANDING_RAD_S = 0.5
# a run of this length moves for most of it, and its evaluation still has something to say
RUN_S = 4.0


@dataclass(slots=True)
class Row:
    """One line of the table.

    Parameters
    ----------
    number : str
        Of the fault.
    fault : str
        What was done.
    trials : int
        How often.
    good : int
        How often everything required was seen.
    worst_stop_s : float or None
        Longest time from the fault to a motor that stands, s; None where nothing turned.
    lost : int or None
        Acknowledged samples that were lost; None where none were taken.
    notes : dict
        What else was counted.
    bad : list of str
        What was seen instead, one line per trial.
    """

    number: str
    fault: str
    trials: int = 0
    good: int = 0
    worst_stop_s: float | None = None
    lost: int | None = None
    notes: dict[str, object] = field(default_factory=dict)
    bad: list[str] = field(default_factory=list)

    def add(self, problem: str, stop_s: float | None = None, lost: int | None = None) -> None:
        """Take in one trial; an empty `problem` means that it went as required."""
        self.trials += 1
        self.good += not problem
        if problem:
            self.bad.append(problem)
        if stop_s is not None:
            self.worst_stop_s = max(self.worst_stop_s or 0.0, stop_s)
        if lost is not None:
            self.lost = (self.lost or 0) + lost

    def count(self, what: str) -> None:
        """Count one more of `what`."""
        self.notes[what] = int(str(self.notes.get(what, 0))) + 1


def short_profile(folder: Path, **limits: float) -> Path:
    """Write the report's bench with a ripple run of four seconds; other numbers in `limits`."""
    text = (Path(__file__).parents[2] / "profiles" / "cim-tr-97-06.toml").read_text()
    head, mark, tail = text.partition("\n[ripple]\n")
    # 0.9 V are 50 rad/s, reached at 1250 rad/s^2: half of what the servo can
    for key, value in (("duration_s", RUN_S), ("frequency_hz", 0.5), ("amplitude_v", 0.9)):
        tail = re.sub(rf"(?m)^{key} = [^#\n]*", f"{key} = {value} ", tail, count=1)
    for key, value in limits.items():
        head, found = re.subn(rf"(?m)^{key} = [^#\n]*", f"{key} = {value} ", head, count=1)
        if not found:
            head = head.replace("\n[limits]\n", f"\n[limits]\n{key} = {value}\n", 1)
    path = folder / ("short.toml" if not limits else "limited.toml")
    path.write_text(head + mark + tail)
    return path


@dataclass(slots=True)
class ServedBench:
    """An emulated bench in real time, with the history of its motor."""

    address: str
    record: Path
    place: int = 0

    def mark(self) -> None:
        """Forget the history so far."""
        self.place = self.record.stat().st_size

    def history(self) -> list[dict[str, float]]:
        """Return what happened since the mark."""
        with self.record.open("rb") as file:
            file.seek(self.place)
            raw = file.read()
        return [json.loads(line) for line in raw.splitlines() if line.endswith(b"}")]

    def phase(self, moment_s: float) -> str:
        """Return what the motor did at a moment, for counting."""
        before = [event for event in self.history() if event["monotonic_s"] <= moment_s]
        if not before:
            return "before the motion"
        return "after the motion" if _still(before[-1]) else "while the motor turned"

    def after(self, since_s: float) -> tuple[float, float, str]:
        """Return times to reference zero and to standstill after `since_s`, s, and what failed.

        Both are 0 where nothing turned. Waits until the motor stands, 6 s at most.
        """
        until_s = time.monotonic() + 6.0
        while True:
            events = self.history()
            if not events or _still(events[-1]):
                break
            if time.monotonic() > until_s:
                return 6.0, 6.0, f"the motor turns at {events[-1]['velocity_rad_s']:.3g} rad/s"
            time.sleep(0.01)
        late = [event for event in events if event["monotonic_s"] >= since_s]
        zero = next((e for e in late if e["reference_v"] == 0.0 and e["state"] != "running"), None)
        still = next((e for e in late if _still(e)), None)
        before = [event for event in events if event["monotonic_s"] < since_s]
        if not before or (_still(before[-1]) and not late):
            return 0.0, 0.0, ""
        return (
            zero["monotonic_s"] - since_s if zero else 0.0,
            still["monotonic_s"] - since_s if still else 0.0,
            "",
        )


def preloaded(
    row: Row, folder: Path, source: str, words: Sequence[str], trials: int
) -> list[dict[str, object]]:
    """Run a script with a few lines of C of this folder before the C library.

    Return the object that it prints for each trial; the row says why some are missing.
    """
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        row.notes["not run"] = "no C compiler"
        return []
    code = Path(__file__).with_name(source)
    shim = folder / f"{code.stem}.so"
    made = [compiler, "-shared", "-fPIC", "-O1", "-o", str(shim), str(code), "-ldl"]
    subprocess.run(made, check=True)
    done = subprocess.run(
        [sys.executable, *words],
        env={**os.environ, "LD_PRELOAD": str(shim)},
        capture_output=True,
        text=True,
        check=False,
    )
    found = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    if len(found) < trials:
        row.add(f"the worker ended early: {done.stderr[-300:]}")
    return found


def in_time(trials: int) -> Iterator[int]:
    """Count trials; end early when the minutes of ``HDBENCH_FAULT_MINUTES`` are over."""
    until_s = time.monotonic() + 60.0 * float(os.environ.get("HDBENCH_FAULT_MINUTES", "inf"))
    for number in range(trials):
        if time.monotonic() > until_s:
            return
        yield number


def _still(event: dict[str, float]) -> bool:
    stands = abs(event["velocity_rad_s"]) < STANDING_RAD_S and event["reference_v"] == 0.0
    return stands and event["state"] != "running"


@contextmanager
def served(folder: Path, profile: Path, pace: str = "realtime") -> Iterator[ServedBench]:
    """Serve an emulated bench in a process of its own."""
    from hdbench.devices.emulator.process import running_emulator
    from hdbench.profile import load_profile

    record = folder / f"motor-{time.monotonic_ns()}.jsonl"
    data, made = load_profile(str(profile)).data, {"plant": "as-modelled", "seed": 0}
    with running_emulator(data, **made, pace=pace, record=record) as found:
        yield ServedBench(str(found["address"]), record)


class acknowledging:  # noqa: N801 - used like a function
    """A counter in shared memory: samples that a run has acknowledged."""

    def __init__(self) -> None:
        self._memory = mmap.mmap(-1, 8)

    @property
    def count(self) -> int:
        """Samples so far."""
        return int(struct.unpack("<q", self._memory[:8])[0])

    def reset(self) -> None:
        """Begin anew."""
        self._memory[:8] = struct.pack("<q", 0)

    def install(self) -> None:
        """Count in this process from now on."""
        from hdbench.session.recorder import TraceRecorder

        add = TraceRecorder.add
        memory = self._memory

        def counting(recorder: TraceRecorder, block: object) -> object:
            rows = add(recorder, block)  # type: ignore[arg-type]
            memory[:8] = struct.pack("<q", recorder.n_rows)
            return rows

        TraceRecorder.add = counting  # type: ignore[method-assign,assignment]


@dataclass(slots=True)
class Run:
    """One command in a process of its own."""

    pid: int
    out: Path
    said: Path
    started_s: float
    code: int | None = None

    def send(self, signum: int) -> None:
        """Send a signal; a process that is gone does not mind."""
        if self.code is None and self.poll() is None:
            os.kill(self.pid, signum)

    def poll(self) -> int | None:
        """Return the exit code once there is one."""
        if self.code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.code = os.waitstatus_to_exitcode(status)
        return self.code

    def wait(self, longest_s: float) -> int | None:
        """Wait for the end; None where it does not come."""
        until_s = time.monotonic() + longest_s
        while self.poll() is None and time.monotonic() < until_s:
            time.sleep(0.005)
        return self.code

    def folder(self) -> Path | None:
        """Return its run folder, None where it has made none."""
        return next((path.parent for path in self.out.glob("*/run.json")), None)

    def words(self) -> str:
        """Return what it said on stderr."""
        return self.said.read_text(errors="replace")

    def children(self, word: bytes) -> list[int]:
        """Return its child processes whose command line holds `word`."""
        found = []
        try:
            listed = Path(f"/proc/{self.pid}/task/{self.pid}/children").read_text().split()
        except OSError:
            return []
        for pid in map(int, listed):
            try:
                if word in Path(f"/proc/{pid}/cmdline").read_bytes():
                    found.append(pid)
            except OSError:
                continue
        return found


def begin(
    folder: Path,
    words: Sequence[str],
    *,
    before: Callable[[], None] = lambda: None,
    limit_bytes: int | None = None,
) -> Run:
    """Start ``hdbench WORDS`` in a fork of this process, its libraries loaded already."""
    import hdbench.session.experiments  # noqa: F401 - what every run loads, loaded once
    import hdbench_cli.main as command_line

    out = folder / f"run-{time.monotonic_ns()}"
    out.mkdir()
    said = out / "stderr.txt"
    pid = os.fork()
    if pid:
        return Run(pid, out, said, time.monotonic())
    code = 70
    try:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            signal.signal(getattr(signal, name), signal.SIG_DFL)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT, 0o644), 2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if limit_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))
        before()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        measures = words[0].startswith(("run-", "calib"))
        command_line.main([*words, *(["--out", str(out)] if measures else [])])
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:  # noqa: BLE001 - the traceback itself is what is looked for
        import traceback

        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)
