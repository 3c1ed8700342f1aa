"""Signals and kills, from outside: a run against a bench in another process."""

import json
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen

import pytest
from forked import ended, hdbench_process
from nodekit import until
from runkit import ran


@dataclass(frozen=True)
class Served:
    """An emulated bench in its own process, with the history of its motor."""

    process: Popen[str]
    record: Path
    words: tuple[str, ...]
    control: str

    def history(self) -> list[dict[str, object]]:
        return [json.loads(line) for line in self.record.read_text().splitlines()]


@contextmanager
def serving(folder: Path, text: str) -> Iterator[Served]:
    record, profile = folder / "motor.jsonl", folder / "bench.toml"
    profile.write_text(text)
    words = ["--profile", str(profile), "--record", str(record)]
    words = ["emulate", "--pace", "realtime", *words, "--json"]
    process = hdbench_process(words, stdout=PIPE, stderr=DEVNULL, text=True)
    told = json.loads(process.stdout.readline())
    found = ("--profile", str(profile), "--address", told["address"])
    yield Served(process, record, found, told["control"])
    process.terminate()
    process.wait(timeout=60)
    process.stdout.close()


@pytest.fixture(scope="module")
def text(changed_profile) -> str:
    """Return a profile in which a busy machine misses no deadline and trips no watchdog."""
    patient = {"watchdog_s": 2.0, "deadline_s": 1.0}
    return changed_profile(daq=patient, calibration={"average_s": 0.2})


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, text: str) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("served"), text) as bench:
        yield bench


def start(served: Served, out: Path, command: str = "run-ripple") -> Popen[str]:
    words = [command, *served.words, "--control", served.control, "--out", out]
    return hdbench_process([*words, "--no-report", "--yes"], stdout=PIPE, stderr=PIPE, text=True)


def journal_size(out: Path) -> int:
    return sum(path.stat().st_size for path in out.glob("*/journal.hdj"))


def manifest(out: Path) -> dict[str, object]:
    (path,) = out.glob("*/run.json")
    return json.loads(path.read_text())


@pytest.mark.parametrize(
    ("command", "written", "kept"),
    # the motor turns; mounting, the bridge at rest and two readings
    [("run-ripple", 20_000, "trace.csv"), ("calibrate", 4_000, "loads.csv")],
)
def test_a_signal_stops_the_motor_and_keeps_the_run(served, tmp_path, command, written, kept):
    out = tmp_path / "runs"
    process = start(served, out, command)
    until(lambda: journal_size(out) > written, 120.0)
    process.send_signal(signal.SIGTERM)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 143, stderr
    assert "Traceback" not in stderr
    run = manifest(out)
    assert run["status"] == "incomplete"
    assert "motor reference zero confirmed" in str(run["exit_reason"])
    assert kept in run["files"]


@pytest.mark.parametrize(
    "delay_s",
    [0.0, 0.4, *(pytest.param(late, marks=pytest.mark.campaign) for late in (0.15, 0.8, 1.2))],
)
def test_a_signal_in_any_phase_gives_no_traceback(served, tmp_path, delay_s):
    out = tmp_path / "runs"
    process = start(served, out)
    until(lambda: any(out.glob("*/run.json")), 60.0)
    time.sleep(delay_s)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    assert manifest(out)["status"] == "incomplete"


def test_kill_9_leaves_the_motor_to_the_guard_and_the_samples_to_verify(tmp_path, text):
    out = tmp_path / "runs"
    with serving(tmp_path, text) as bench:
        process = start(bench, out)
        until(lambda: journal_size(out) > 50_000, 60.0)
        os.kill(process.pid, signal.SIGKILL)
        process.communicate(timeout=60)
        until(lambda: bench.history()[-1]["event"] == "standstill", 60.0)
        assert bench.history()[-1]["reference_v"] == 0.0
        assert bench.history()[-1]["watchdog_trips"] == 0
    (folder,) = out.iterdir()
    assert manifest(out)["status"] == "running"
    ran("runs", "verify", folder, "--recover")
    assert manifest(out)["status"] == "incomplete"
    assert (folder / "trace.csv").read_text().count("\n") > 100


def test_a_second_run_is_refused_and_stop_stops_the_motor_of_the_first(served, tmp_path, answer):
    out = tmp_path / "runs"
    first = start(served, out)
    until(lambda: journal_size(out) > 20_000, 60.0)
    second = start(served, tmp_path / "other")
    _, stderr = second.communicate(timeout=60)
    assert second.returncode == 9, stderr
    assert first.poll() is None
    body = answer("stop", *served.words)
    assert body["confirmed"] is True
    assert body["reference_v"] == 0.0
    first.communicate(timeout=60)
    assert first.returncode != 0
    assert manifest(out)["status"] == "incomplete"


def test_a_bench_that_dies_ends_the_run_loudly(tmp_path, text):
    out = tmp_path / "runs"
    with serving(tmp_path, text) as bench:
        process = start(bench, out)
        until(lambda: journal_size(out) > 20_000, 60.0)
        bench.process.kill()
        _, stderr = process.communicate(timeout=60)
    # nobody answers, so the safe state cannot be confirmed: the loudest exit
    assert process.returncode == 8, stderr
    assert "SAFE STATE COULD NOT BE CONFIRMED" in stderr
    assert manifest(out)["status"] == "incomplete"


def test_ctrl_c_before_a_command_listens_leaves_no_traceback():
    done = ended([sys.executable, "-c", "import hdbench_cli; raise KeyboardInterrupt"])
    assert done.stderr == "stopped\n"
    # an uncaught interrupt ends the process by its own signal: a shell says 130
    assert done.returncode == -signal.SIGINT


# the signal comes while an object is cleared away: what is raised there is dropped by Python
CLEARING = """
import os, signal, sys, time, weakref
from hdbench_cli import main

# at once: the signal is sent again while the main thread still deals with the lost one
main._AGAIN_S = 0.0

# tests that run in the background are born deaf to Ctrl-C
signal.signal(signal.SIGINT, signal.default_int_handler)

class Thing: pass

main.end_by_signals()
thing = Thing()
hook = weakref.ref(thing, lambda _: os.kill(os.getpid(), int(sys.argv[1])))
del thing
time.sleep(float(sys.argv[2]))
"""


@pytest.mark.parametrize(
    ("signum", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129), (signal.SIGINT, -2)]
)
def test_a_signal_that_comes_while_something_is_cleared_away_is_not_lost(signum, code):
    done = ended([sys.executable, "-c", CLEARING, int(signum), 50])
    assert done.returncode == code
    assert "ignored" not in done.stderr


def test_what_else_python_cannot_raise_is_told_as_ever():
    script = CLEARING.replace("os.kill(os.getpid(), int(sys.argv[1]))", "1 / 0")
    done = ended([sys.executable, "-c", script, 0, 0])
    assert "ZeroDivisionError" in done.stderr
