"""Faults of the wall clock, and of the person: no answer, end of input, a closed terminal.

The clock is set by a few lines of C (`clock.c`) loaded before the C library: what the system
says of the time of day jumps while a run is under way. Needs a C compiler.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import pty
import random
import select
import shutil
import signal
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from faults.kit import Row, in_time, preloaded, short_profile
from faults.lines import emulated
from hdbench.devices.emulator.machine import NodeMachine
from hdbench.devices.emulator.node import NodeCore, identity_values, limit_values
from hdbench.devices.node.registers import Capability
from hdbench.plant.bench import SimulatedBench
from hdbench.plant.plantfile import load_plant
from hdbench.profile import load_profile

__all__ = ["clock_steps", "people"]

# a question has to come within this time on a busy machine
LONGEST_S = 60.0
STILL_RAD_S = 0.5
# how a command may end that has got no yes: not confirmed, or ended by a signal
ALLOWED = {
    "silence": (143,), "end of input": (2, 3, 5, 130), "closed": (129,), "no": (2, 3, 5),
    "interrupt": (130,), "words": (2, 3, 5, 130),
}  # fmt: skip


def clock_steps(folder: Path, trials: int, seed: int) -> Row:
    """Set the wall clock by an hour, a day, some seconds, while a run measures: same bytes."""
    row = Row("21", "wall clock set by up to a day, at any moment of a run, forward and back")
    asked = {"place": str(folder), "profile": str(short_profile(folder)), "seed": seed}
    words = [__file__, json.dumps({**asked, "trials": trials})]
    for line in preloaded(row, folder, "clock.c", words, trials):
        row.add(str(line["problem"]))
    return row


def _worker(asked: dict[str, object]) -> None:
    """Run the trials in this process, whose wall clock can be set."""
    clock, chance = ctypes.CDLL(None), random.Random(int(str(asked["seed"])))
    before = int(time.time())
    clock.fault_clock_set(3600)
    if not 3590 < time.time() - before < 3700:
        raise RuntimeError("the clock cannot be set")
    clock.fault_clock_set(0)
    wanted = _measured(asked, 0)
    for number in range(1, 1 + int(str(asked["trials"]))):
        steps = [chance.choice((1, -1)) * chance.choice((1, 37, 3600, 86400)) for _ in range(20)]
        ended = threading.Event()

        def jump(steps: list[int] = steps, ended: threading.Event = ended) -> None:
            for step in steps:
                clock.fault_clock_set(step)
                if ended.wait(chance.uniform(0.01, 0.3)):
                    return

        thread = threading.Thread(target=jump)
        thread.start()
        try:
            found = _measured(asked, number)
        finally:
            ended.set()
            thread.join()
            clock.fault_clock_set(0)
        problem = "" if found == wanted else f"{found} instead of {wanted}"
        print(json.dumps({"problem": problem}), flush=True)


def _measured(asked: dict[str, object], number: int) -> tuple[str, str]:
    """Return what a run of the embedded bench measured and found, without its dates."""
    from hdbench.session import BenchOptions, run_experiment

    out = Path(str(asked["place"])) / f"clock-{number}"
    options = BenchOptions(out, seed=3)
    profile = load_profile(str(asked["profile"]))
    try:
        outcome = run_experiment("ripple", profile, options, lambda _what, _share: None)
        trace = (outcome.folder.path / "trace.csv").read_bytes()
        result = json.loads((outcome.folder.path / "result.json").read_text())
        return hashlib.sha256(trace).hexdigest(), json.dumps(result.get("ripple"))
    finally:
        shutil.rmtree(out, ignore_errors=True)


@contextmanager
def unsimulated(profile: Path) -> Iterator[tuple[str, list[float]]]:
    """Serve an emulated bench that says it is a real one; yields address and speeds recorded."""
    data, speeds = load_profile(str(profile)).data, []

    def record(event: Mapping[str, object]) -> None:
        speeds.append(abs(float(str(event["velocity_rad_s"]))))

    bench = SimulatedBench(data, load_plant("as-modelled"), 0)
    identity = dict(identity_values(0))
    identity["capabilities"] = int(identity["capabilities"]) & ~int(Capability.SIMULATED)
    machine = NodeMachine(bench, pace="realtime", clock=time.monotonic, record=record)
    core = NodeCore(machine, identity=identity, limits=limit_values(data), clock=time.monotonic)
    with emulated(core) as address:
        yield address, speeds


def people(folder: Path, trials: int, seed: int) -> Row:
    """Answer the question before a motion by nothing, end of input, a hang-up, no, Ctrl-C."""
    row = Row("24", "the question before a motion: no answer, end of input, terminal closed, no, "
              "Ctrl-C")  # fmt: skip
    chance = random.Random(seed)
    acts = ("closed", "end of input", "silence", "no", "interrupt", "words")
    profile = short_profile(folder)
    with unsimulated(profile) as (address, speeds):
        for number in in_time(trials):
            act = acts[number % len(acts)]
            out = folder / f"person-{time.monotonic_ns()}"
            out.mkdir()
            command = ["run-ripple", "--profile", str(profile), "--address", address,
                       "--no-report", "--out", str(out)]  # fmt: skip
            code, said = _asked(command, act, chance)
            row.count(f"{act}: exit {code}")
            problem = "the motor turned" if max(speeds, default=0.0) > STILL_RAD_S else ""
            speeds.clear()
            problem = problem or ("" if "?" in said else f"no question: {said[-200:]}")
            row.add(problem or _judged(act, code, said))
            shutil.rmtree(out, ignore_errors=True)
    return row


def _judged(act: str, code: int | None, said: str) -> str:
    """Return what was wrong with the end of a command."""
    if "Traceback" in said:
        return f"traceback: {said[-400:]}"
    allowed = ALLOWED[act]
    return "" if code in allowed else f"{act}: exit {code}: {said[-200:]}"


def _asked(command: list[str], act: str, chance: random.Random) -> tuple[int | None, str]:
    """Start a command at a terminal of its own, wait for its question, and act."""
    pid, terminal = pty.fork()
    if not pid:
        os.execv(sys.executable, [sys.executable, "-m", "hdbench_cli", *command])
    said, open_still = b"", True
    until_s = time.monotonic() + LONGEST_S
    while b"?" not in said and time.monotonic() < until_s:
        piece = _read(terminal, 0.2)
        if piece is None:
            break
        said += piece
    time.sleep(chance.uniform(0.0, 0.3))
    if act == "silence":
        time.sleep(1.0)
        os.kill(pid, signal.SIGTERM)
    elif act == "closed":
        os.close(terminal)
        open_still = False
    else:
        keys = {
            "end of input": b"\x04",
            "no": b"n\n",
            "interrupt": b"\x03",
            "words": b"maybe\n\x04",
        }
        os.write(terminal, keys[act])
    code = None
    while time.monotonic() < until_s:
        piece = _read(terminal, 0.05) if open_still else b""
        said += piece or b""
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            code = os.waitstatus_to_exitcode(status)
            break
        if not piece:
            time.sleep(0.01)
    else:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
    if open_still:
        os.close(terminal)
    return code, said.decode(errors="replace")


def _read(terminal: int, wait_s: float) -> bytes | None:
    """Return what the command says; None once it has left its terminal."""
    if not select.select([terminal], (), (), wait_s)[0]:
        return b""
    try:
        return os.read(terminal, 4096)
    except OSError:
        return None


if __name__ == "__main__":
    _worker(json.loads(sys.argv[1]))
