"""Run hdbench as on a system without POSIX: usage ``python tools/portability.py [--short]``.

A demo, the three experiments, a calibration with a person that is broken off and resumed, the
monitor, and a stop of a bench that another process drives, all over TCP, with everything hidden
that Windows does not have (``tools/hiding.py``). ``--short`` leaves the demo out. With
``--as-it-is`` nothing is hidden: for a computer that is such a system. Exit code 0 when every step
did what it does elsewhere.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

HIDING = str(Path(__file__).with_name("hiding.py"))
_LONGEST_S = 900.0
_MAIN = """
import json, sys
from hdbench_cli.main import main
codes = []
for words in json.loads(sys.argv[1]):
    try:
        main(words)
    except SystemExit as end:
        codes.append(end.code or 0)
sys.exit(json.dumps(codes) if any(codes) else 0)
"""
# a bench with six weights to hang, and a ripple run of four seconds: keys of tables
_SMALL = {
    "calibration": {"positions": 1, "directions": ["cw"], "ranges": ["low"], "average_s": 0.5,
                    "low_masses_kg": [0.0, 0.5, 1.0]},
    "ripple": {"duration_s": 4.0},
    "ripple.reference": {"frequency_hz": 0.5, "amplitude_v": 0.9},
    "misalignment": {"velocity_rad_s": 300.0},
}  # fmt: skip


def program(hidden: bool) -> str:
    """Return the program that runs commands of hdbench one after the other."""
    if not hidden:
        return _MAIN
    return (
        f"exec(compile(open({HIDING!r}).read(), {HIDING!r}, 'exec'), "
        f"{{'__name__': 'hiding', '__file__': {HIDING!r}}})\n{_MAIN}"
    )


def small_profile(folder: Path) -> Path:
    """Write the report's bench with fewer weights and shorter motion."""
    text = (Path(__file__).parents[1] / "profiles" / "cim-tr-97-06.toml").read_text("utf-8")
    keys, lines = {}, []
    for line in text.splitlines():
        keys = _SMALL.get(line.strip("[]"), {}) if line.startswith("[") else keys
        key = line.partition(" = ")[0]
        lines.append(f"{key} = {json.dumps(keys[key])}" if key in keys else line)
    path = folder / "small.toml"
    path.write_text("\n".join(lines), "utf-8")
    return path


class ForeignSystem:
    """Steps in processes from which POSIX is hidden.

    Parameters
    ----------
    folder : Path
        For everything that is written.
    hidden : bool
        Whether it is hidden.
    """

    def __init__(self, folder: Path, *, hidden: bool = True) -> None:
        self.folder = folder
        self.out = folder / "runs"
        self.profile = str(small_profile(folder))
        self._start = [sys.executable, "-c", program(hidden)]

    def run(self, *commands: Sequence[str], answers: str = "") -> subprocess.CompletedProcess[str]:
        """Run commands in one process; its exit code is 0 when all of theirs are."""
        return subprocess.run(
            [*self._start, json.dumps(commands)],
            input=answers,
            capture_output=True,
            text=True,
            timeout=_LONGEST_S,
            check=False,
        )

    def succeed(self, *commands: Sequence[str], answers: str = "") -> str:
        """Run commands that have to succeed, and return what they print."""
        done = self.run(*commands, answers=answers)
        if done.returncode:
            raise AssertionError(f"{commands}: {done.stderr[-2000:]}")
        return done.stdout

    @contextmanager
    def started(self, *words: str) -> Iterator[subprocess.Popen[str]]:
        """Run one command beside others; end it at the latest at the end."""
        process = subprocess.Popen(
            [*self._start, json.dumps([words])],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            yield process
        finally:
            process.kill()
            process.communicate()

    def experiments(self) -> None:
        """Measure ripple and misalignment, and look on, at the embedded bench."""
        given = ("--profile", self.profile)
        kept = ("--out", str(self.out / "motion"), "--no-report", "--yes")
        self.succeed(
            ("run-ripple", *given, *kept),
            ("run-misalignment", *given, *kept),
            ("monitor", *given, "--duration", "0.5"),
        )
        for run in (self.out / "motion").iterdir():
            self._complete(run)
            if (run / "guard.jsonl").exists():
                raise AssertionError(f"{run}: the guard had to act")

    def calibration(self) -> None:
        """Calibrate with a person who leaves after two weights, and resume."""
        out = self.out / "calibration"
        words = ("calibrate", "--profile", self.profile, "--out", str(out), "--no-report")
        done = self.run((*words, "--operator", "person"), answers="\n\n\n\n")
        (run,) = out.iterdir()
        if "[5]" not in done.stderr:
            raise AssertionError(f"answers that end: {done.stderr[-2000:]}")
        again = ("runs", "resume", str(run), "--no-report", "--operator", "person")
        self.succeed(again, answers=20 * "\n")
        self._complete(run)

    def stop(self) -> None:
        """Stop a bench that another process drives."""
        record = self.folder / "node.jsonl"
        given = ("--profile", self.profile)
        with self.started("emulate", *given, "--record", str(record), "--json") as bench:
            address = json.loads(bench.stdout.readline())["address"] if bench.stdout else ""
            motion = ("--out", str(self.out / "stopped"), "--no-report", "--yes")
            with self.started("run-misalignment", *given, *motion, "--address", address) as run:
                self._turning(record, run)
                said = self.succeed(("stop", *given, "--address", address, "--json"))
                if not json.loads(said)["confirmed"]:
                    raise AssertionError(f"stop: {said}")
                run.wait(_LONGEST_S)
                if not run.returncode:
                    raise AssertionError("a run went on whose motor was stopped")

    def demo(self) -> None:
        """Run the whole."""
        self.succeed(("demo", "--out", str(self.out / "demo"), "--json"))

    @staticmethod
    def _complete(run: Path) -> None:
        if json.loads((run / "run.json").read_text("utf-8"))["status"] != "complete":
            raise AssertionError(f"{run} is not complete")

    @staticmethod
    def _turning(record: Path, run: subprocess.Popen[str]) -> None:
        until_s = time.monotonic() + 60.0
        while time.monotonic() < until_s and run.poll() is None:
            lines = record.read_text("utf-8").splitlines(keepends=True) if record.exists() else []
            events = [json.loads(line) for line in lines if line.endswith("}\n")]
            if events and abs(events[-1]["velocity_rad_s"]) > 5.0:
                return
            time.sleep(0.02)
        raise AssertionError("the motor never turned")


def main() -> int:
    """Run the steps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="without the demo")
    parser.add_argument("--as-it-is", action="store_true", help="hide nothing")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        steps = ForeignSystem(Path(folder), hidden=not asked.as_it_is)
        for step in (steps.experiments, steps.calibration, steps.stop, steps.demo):
            if step == steps.demo and asked.short:
                continue
            start_s = time.monotonic()
            step()
            print(f"{step.__name__}: done in {time.monotonic() - start_s:.1f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
