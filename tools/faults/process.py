"""Faults of the process: signals, kills, freezes, a lost guard, two at once, a busy computer."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from faults.kit import RUN_S, Row, Run, ServedBench, acknowledging, begin, in_time, short_profile
from hdbench.records.counted import summarize_journal

__all__ = ["freezes", "kills", "limits", "load", "lost_guards", "races", "signals"]

ZERO_S, STAND_S, EXIT_S, KILL_S = 0.5, 2.0, 4.0, 1.0
# a run and everything after it on a busy machine
LONGEST_S = 40.0
# a node keeps the session of a dead host for 2 s
_HELD_S = 2.1


def _measure(folder: Path, bench: ServedBench, profile: Path, counter: acknowledging) -> Run:
    bench.mark()
    counter.reset()
    words = ["run-ripple", "--profile", str(profile), "--address", bench.address]
    return begin(folder, [*words, "--yes", "--no-report"], before=lambda: counter.install())


def _lost(run: Run, counter: acknowledging) -> int:
    folder = run.folder()
    journal = None if folder is None else folder / "journal.hdj"
    if journal is None or not journal.exists():
        return counter.count
    return max(0, counter.count - summarize_journal(journal).samples)


def _moving(bench: ServedBench, run: Run) -> bool:
    """Wait until the motor turns; False where the run ends before."""
    until_s = time.monotonic() + LONGEST_S
    while time.monotonic() < until_s and run.poll() is None:
        events = bench.history()
        if events and abs(events[-1]["velocity_rad_s"]) > 5.0:
            return True
        time.sleep(0.01)
    return False


def _wait_somewhere(bench: ServedBench, run: Run, chance: random.Random, turning: float) -> None:
    """Wait for a moment of a run: a share of them while the motor turns, the others any."""
    if chance.random() < turning and _moving(bench, run):
        run.wait(chance.uniform(0.0, 0.9 * RUN_S))
    else:
        run.wait(chance.uniform(0.02, RUN_S + 2.0))


def _turning(
    row: Row, folder: Path, bench: ServedBench, profile: Path, counter: acknowledging, trials: int
) -> Iterator[Run]:
    """Yield runs whose motor has begun to turn; one that never did is a bad trial."""
    for _ in in_time(trials):
        run = _measure(folder, bench, profile, counter)
        if _moving(bench, run):
            yield run
        else:
            row.add(f"never moved: {run.words()[-200:]}")


def _status(run: Run) -> str:
    folder = run.folder()
    return "" if folder is None else str(json.loads((folder / "run.json").read_text())["status"])


def signals(folder: Path, bench: ServedBench, profile: Path, trials: int, seed: int) -> Row:
    """SIGINT, SIGTERM, SIGHUP, one to five times, at any moment of a run."""
    row = Row("1", "SIGINT, SIGTERM or SIGHUP, one to five times, in every phase")
    chance, counter = random.Random(seed), acknowledging()
    worst_zero_s = worst_exit_s = 0.0
    for _ in in_time(trials):
        run = _measure(folder, bench, profile, counter)
        first = chance.choice((signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
        _wait_somewhere(bench, run, chance, turning=0.5)
        sent_s = time.monotonic()
        done = run.code is not None
        sent = [first]
        run.send(first)
        for _ in range(chance.randrange(5)):
            time.sleep(chance.uniform(0.01, 0.2))
            sent.append(chance.choice((signal.SIGINT, signal.SIGTERM, signal.SIGHUP)))
            run.send(sent[-1])
        code = run.wait(LONGEST_S)
        exit_s = time.monotonic() - sent_s
        zero_s, still_s, problem = bench.after(sent_s)
        lost = _lost(run, counter)
        row.count("ended before the signal" if done else f"exit {code}")
        if not done:
            row.count(bench.phase(sent_s))
        if not done:
            worst_zero_s, worst_exit_s = max(worst_zero_s, zero_s), max(worst_exit_s, exit_s)
        # signals that wait together come in the order of their numbers; before the command has
        # begun to listen, and made anything, the system ends the process by itself
        allowed = {0} if done else {0, *(128 + number for number in sent)}
        allowed |= set() if run.folder() else {-number for number in sent}
        late = not done and (zero_s > ZERO_S or still_s > STAND_S or exit_s > EXIT_S)
        problem = problem or (
            f"exit {code}" if code not in allowed else
            f"traceback: {run.words()[-1200:]}" if "Traceback" in run.words() else
            f"zero {zero_s:.2f} s, standing {still_s:.2f} s, exit {exit_s:.2f} s" if late else
            "run.json says running" if _status(run) == "running" else ""
        )  # fmt: skip
        row.add(problem, None if done else still_s, lost)
    row.notes |= {"worst zero s": round(worst_zero_s, 3), "worst exit s": round(worst_exit_s, 3)}
    return row


def kills(
    folder: Path, bench: ServedBench, profile: Path, trials: int, seed: int, *, resumes: int
) -> Row:
    """SIGKILL at any moment; the journal is read, and some of the runs are resumed."""
    row = Row("2", "SIGKILL of the session at a random moment, then runs resume")
    chance, counter, resumed = random.Random(seed), acknowledging(), 0
    for _ in in_time(trials):
        run = _measure(folder, bench, profile, counter)
        _wait_somewhere(bench, run, chance, turning=0.667)
        if run.poll() is not None:
            row.count(f"ended by itself, exit {run.code}: no trial")
            continue
        killed_s = time.monotonic()
        run.send(signal.SIGKILL)
        run.wait(5.0)
        zero_s, still_s, problem = bench.after(killed_s)
        lost = _lost(run, counter)
        problem = problem or (f"{lost} samples lost" if lost else "")
        problem = problem or (f"standing after {still_s:.2f} s" if still_s > KILL_S else "")
        row.count(bench.phase(killed_s))
        begun = run.code == -9 and run.folder() is not None
        if not problem and begun and resumed < resumes:
            problem, resumed = _resumed(folder, bench, run), resumed + 1
            row.count("resumed" if not problem else "not resumed")
        row.add(problem, still_s, lost)
        row.notes["worst zero s"] = _worse(row, zero_s)
        # the session of a dead host is the node's for 2 s
        time.sleep(_HELD_S)
    return row


def _worse(row: Row, zero_s: float) -> float:
    return max(float(str(row.notes.get("worst zero s", 0.0))), round(zero_s, 3))


def _resumed(folder: Path, bench: ServedBench, run: Run) -> str:
    time.sleep(_HELD_S)
    words = ["runs", "resume", str(run.folder()), "--address", bench.address, "--yes"]
    again = begin(folder, [*words, "--no-report"])
    code = again.wait(LONGEST_S)
    return (
        "" if code == 0 and _status(run) == "complete" else f"resume: {code} {again.words()[-200:]}"
    )


def freezes(folder: Path, bench: ServedBench, profile: Path, trials: int, seed: int) -> Row:
    """SIGSTOP while the motor turns; the guard stops it; then SIGCONT."""
    row = Row("4", "SIGSTOP of the session while the motor turns, SIGCONT afterwards")
    chance, counter = random.Random(seed), acknowledging()
    for run in _turning(row, folder, bench, profile, counter, trials):
        time.sleep(chance.uniform(0.0, 0.6 * RUN_S))
        stopped_s = time.monotonic()
        run.send(signal.SIGSTOP)
        _, still_s, problem = bench.after(stopped_s)
        trips = bench.history()[-1]["watchdog_trips"]
        run.send(signal.SIGCONT)
        code = run.wait(LONGEST_S)
        done = code == 0
        by_guard = "the guard has stopped" in run.words()
        row.count("by the guard" if by_guard else "finished before" if done else "by the watchdog")
        row.notes["watchdog trips"] = trips
        problem = problem or (f"exit {code}" if code not in (5, 0) else "")
        problem = problem or (f"standing after {still_s:.2f} s" if still_s > KILL_S else "")
        row.add(problem, still_s, _lost(run, counter))
    return row


def lost_guards(folder: Path, bench: ServedBench, profile: Path, trials: int, seed: int) -> Row:
    """SIGKILL of the guard: the session notices and stops."""
    row = Row("3", "SIGKILL of the guard while the motor turns")
    chance, counter = random.Random(seed), acknowledging()
    for run in _turning(row, folder, bench, profile, counter, trials):
        time.sleep(chance.uniform(0.0, 0.4 * RUN_S))
        guards = run.children(b"process.watching")
        killed_s = time.monotonic()
        for pid in guards:
            os.kill(pid, signal.SIGKILL)
        code = run.wait(LONGEST_S)
        zero_s, still_s, problem = bench.after(killed_s)
        problem = problem or ("no guard" if not guards else "")
        problem = problem or (f"exit {code}" if code != 5 else "")
        problem = problem or (f"zero after {zero_s:.2f} s" if zero_s > ZERO_S else "")
        row.add(problem, still_s, _lost(run, counter))
    return row


def races(folder: Path, bench: ServedBench, profile: Path, trials: int, _seed: int) -> Row:
    """Two runs started at once on one bench: one gets it, the other is told so."""
    row = Row("23", "two runs started at once on one bench")
    counter = acknowledging()
    for _ in in_time(trials):
        pair = [_measure(folder, bench, profile, counter) for _ in range(2)]
        until_s = time.monotonic() + LONGEST_S
        while all(run.poll() is None for run in pair) and time.monotonic() < until_s:
            time.sleep(0.01)
        for run in pair:
            run.send(signal.SIGINT)
        codes = sorted(str(run.wait(LONGEST_S)) for run in pair)
        _, _, problem = bench.after(time.monotonic())
        row.add(problem or ("" if codes in (["130", "9"], ["0", "9"]) else f"exits {codes}"))
    return row


def limits(folder: Path, bench: ServedBench, _profile: Path, trials: int, _seed: int) -> Row:
    """Cross a limit with the motion: the run is aborted, exit 3."""
    row = Row("20", "travel beyond its limit: the bench turns faster than its profile says")
    # the plan takes 35 rad by this gain; the bench turns 1.4 times as far
    low = short_profile(folder, travel_rad=40.0, velocity_gain_rad_s_per_v=40.0)
    counter = acknowledging()
    for _ in in_time(trials):
        run = _measure(folder, bench, low, counter)
        code = run.wait(LONGEST_S)
        _, _, problem = bench.after(time.monotonic())
        problem = problem or (f"exit {code}: {run.words()[-200:]}" if code != 3 else "")
        row.add(problem or ("" if _status(run) == "aborted" else _status(run)))
    return row


def load(folder: Path, bench: ServedBench, profile: Path, trials: int, _seed: int) -> Row:
    """Two busy loops beside the run: every sample is there, or counted as lost."""
    row = Row("28", "two other processes that take all they get, 4 s at 1 kHz each")
    counter = acknowledging()
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    try:
        for _ in in_time(trials):
            run = _measure(folder, bench, profile, counter)
            code = run.wait(LONGEST_S)
            lost = _lost(run, counter)
            row.count(f"exit {code}")
            # 5: the watchdog or the guard found this computer too slow, and stopped the motor
            problem = "" if code in (0, 5, 6) and not lost else f"exit {code}, {lost} lost"
            _, still_s, moving = bench.after(time.monotonic())
            row.add(problem or moving, still_s, lost)
    finally:
        for process in busy:
            process.kill()
            process.wait()
    return row
