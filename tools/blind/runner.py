"""Run the diagnosis over sealed records: many processes, resumable, one line of JSON per answer.

The truth of a case is committed to (`manifest.jsonl`) before any record is diagnosed, the truth of
a record (size, group, bounds) before that record is. The diagnosis gets channels and a profile.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import json
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import date
from itertools import takewhile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "blind"))

from injector.build import Case, Hidden, Made  # noqa: E402
from injector.cases import make  # noqa: E402
from injector.seal import case_text, salt_of, seal, truth_text  # noqa: E402
from injector.signatures import axes_of, signatures  # noqa: E402
from proposal import proposal  # noqa: E402
from real_records import profile_with, real_profile, real_trace, real_truth  # noqa: E402
from rivals.oracle import oracle  # noqa: E402
from scorer.spans import Spanned, axes_shares, names_share  # noqa: E402

from hdbench.batch import Workers, run_tasks  # noqa: E402
from hdbench.diagnosis import diagnose_loads, diagnose_trace  # noqa: E402
from hdbench.errors import HdbenchError  # noqa: E402
from hdbench.profile import Profile  # noqa: E402
from hdbench.records import LoadReading, Loads, Trace  # noqa: E402

__all__ = ["Options", "answer_case", "case_of", "end_line", "fresh_base", "read_lines", "run"]

# a diagnosis that takes longer than this has failed: thirty times the time asked for
_PATIENCE_S = 300
_KEYS = (
    "verdict", "causes", "minor", "unexplained", "minor_unexplained", "data_flags",
    "minimum_detectable", "simulated", "extended", "settings", "left_out", "rest",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Options:
    """How to run: folder of the results, processes, whether to fit the oracle, core niceness."""

    out: Path
    processes: int = 1
    with_oracle: bool = True
    stop_after_s: float = float("inf")


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Return the whole lines of a file; one cut short by a stop is left out and asked again."""
    out = []
    if path.exists():
        for line in path.read_text().splitlines():
            try:
                out.append(json.loads(line))
            except json.JSONDecodeError:
                continue
    return out


def end_line(path: Path) -> None:
    """End a line that a kill cut short, so that the next one stands alone."""
    if path.exists() and path.stat().st_size and not path.read_bytes().endswith(b"\n"):
        with path.open("a") as file:
            file.write("\n")


def fresh_base(day: str | None = None) -> int:
    """Return a base seed from the commit and the date: new every day, and for all to repeat."""
    commit = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.strip()
    words = f"{commit} {day or date.today().isoformat()}"
    return int(hashlib.sha256(words.encode()).hexdigest()[:12], 16)


def _profile(bits: int) -> Profile:
    return profile_with({} if bits == 16 else {"daq.resolution_bits": bits})


def _peak_reset() -> None:
    # what a longer record before left in the heap is none of this one's
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return


def _peak_mb() -> float:
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) / 1024.0
    except OSError:
        pass
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _expire(thread: int) -> None:
    """Raise in the thread that diagnoses: in a worker that is not the main one."""
    ctypes.pythonapi.PyThreadState_SetAsyncExc(
        ctypes.c_ulong(thread), ctypes.py_object(TimeoutError)
    )


def _diagnose(case: Case, made: Any, materiality: float) -> dict[str, Any]:
    profile = real_profile(case) if case.part == "R" else _profile(case.bits)
    seed = int(hashlib.sha256(case.key.encode()).hexdigest()[:8], 16)
    if case.part == "L":
        readings = tuple(LoadReading(**row) for row in made.columns["readings"])
        result = diagnose_loads(Loads(readings, source="blind"), profile)
    else:
        trace = Trace(made.columns, source="blind")
        result = diagnose_trace(trace, profile, materiality=materiality, seed=seed)
    answer = result.to_json()
    return {key: answer[key] for key in _KEYS if key in answer}


def materiality_of(part: str) -> float:
    """Return the line between causes and minor ones: none where sizes are in sigmas."""
    return 0.01 if part in "PFTR" else 0.0


def _made(case: Case) -> Made:
    """Make the record of `case`, or read it where others measured it."""
    if case.part != "R":
        return make(case)
    return Made(dict(real_trace(case).columns), real_truth(case), None, ())


def _spans(made: Made, answer: dict[str, Any]) -> dict[str, Any]:
    """Say which share of the hidden effect the answer's axes and names span on this record."""
    scene = made.scene
    known = scene.baseline()
    spanned = Spanned(made.torques[0], known, axes_of(scene))
    bursts = made.truth["hidden"][0]["shape"].get("recipe") == "bursts"
    causes = [*answer["causes"], *answer.get("minor", ())]
    told = [(name, cause["parameters"]) for cause in causes
            for name in {cause["name"], *cause.get("group", ())}]  # fmt: skip
    best, names, each = names_share(spanned, signatures(scene, told))
    axes = axes_shares(spanned, answer["unexplained"], bursts)
    return {"unexplained": axes, "names": best, "by": names, "each": each}


def answer_case(case: Case, with_oracle: bool = True) -> tuple[dict[str, Any], dict[str, Any]]:
    """Make the record of `case`, seal its truth, diagnose it: (sealed truth, answer)."""
    begin = time.perf_counter()
    made = _made(case)
    truth = dict(made.truth)
    if with_oracle and made.truth["hidden"] and case.part in "BPC":
        truth["oracle"] = oracle(made)
    salt, text = salt_of(case), truth_text(truth)
    sealed = {"key": case.key, "salt": salt, "text": text, "case": case_text(case)}
    entry: dict[str, Any] = {"key": case.key, "seal": seal(salt, text)}
    entry["made_s"] = round(time.perf_counter() - begin, 2)
    _peak_reset()
    patience = threading.Timer(_PATIENCE_S, _expire, [threading.get_ident()])
    patience.daemon = True
    patience.start()
    begin, burnt = time.perf_counter(), time.process_time()
    try:
        entry["answer"] = _diagnose(case, made, materiality_of(case.part))
    except HdbenchError as error:
        entry["refused"] = f"{type(error).__name__}: {error}"
    except Exception as error:  # noqa: BLE001 - a crash is an answer too, and it is counted
        entry["crashed"] = f"{type(error).__name__}: {error}"
    finally:
        patience.cancel()
    entry["seconds"] = round(time.perf_counter() - begin, 3)
    entry["cpu_s"] = round(time.process_time() - burnt, 3)
    entry["peak_mb"] = round(_peak_mb(), 1)
    if case.note.endswith("|poor") and entry.get("answer", {}).get("causes"):
        entry["proposal"] = proposal(made, entry["answer"], _profile(case.bits).data, case.bits)
    if case.part == "U" and "answer" in entry:
        entry["spans"] = _spans(made, entry["answer"])
    if case.part == "R":
        entry["torque_rms_nm"] = float((made.columns["torque_nm"] ** 2).mean() ** 0.5)
    return sealed, entry


def case_of(text: str) -> Case:
    """Return the case that was sealed as `text`."""
    fields = json.loads(text)
    hidden = tuple(
        Hidden(entry["name"], entry["tier"], tuple(map(tuple, entry["fixed"])))
        for entry in fields.pop("hidden")
    )
    return Case(hidden=hidden, **fields)


def _answer_task(task: tuple[Case, bool]) -> tuple[dict[str, Any], dict[str, Any]]:
    return answer_case(*task)


def _commit(cases: list[Case], out: Path) -> None:
    """Write the seals of all cases that have none yet."""
    path = out / "manifest.jsonl"
    known = {entry["key"]: entry["seal"] for entry in read_lines(path)}
    with path.open("a") as file:
        for case in cases:
            mark = seal(salt_of(case), case_text(case))
            if case.key not in known:
                file.write(json.dumps({"key": case.key, "seal": mark}) + "\n")
            elif known[case.key] != mark:
                raise SystemExit(f"{path}: {case.key} was sealed with another truth; use --out")


class _Brake:
    """Says when to stop: the time is over, or the first Ctrl-C; a second one kills as usual."""

    def __init__(self, seconds: float) -> None:
        self._end = time.monotonic() + seconds
        self._pressed = False
        self._before = {
            number: signal.signal(number, self._press) for number in (signal.SIGINT, signal.SIGTERM)
        }

    def _press(self, *_: object) -> None:
        self._pressed = True
        self.release()
        print("finishing the records under way", file=sys.stderr, flush=True)

    def release(self) -> None:
        """Give the signals back to whoever had them."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __bool__(self) -> bool:
        return self._pressed or time.monotonic() > self._end


def _answers(
    todo: list[Case], options: Options, brake: _Brake
) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield truth and answer of each case as they come, until the brake is pulled."""
    tasks = ((case, options.with_oracle) for case in takewhile(lambda _: not brake, todo))
    for outcome in run_tasks(_answer_task, tasks, Workers(options.processes)):
        if outcome.lost:
            print(f"{outcome.task[0].key}: the worker died", file=sys.stderr, flush=True)
        else:
            yield outcome.value


def run(cases: Iterable[Case], options: Options) -> int:
    """Diagnose all cases that have no answer yet; return how many were answered now."""
    options.out.mkdir(parents=True, exist_ok=True)
    chosen = list(cases)
    _commit(chosen, options.out)
    path = options.out / "answers.jsonl"
    done = {entry["key"] for entry in read_lines(path)}
    todo = [case for case in chosen if case.key not in done]
    count, begin, brake = 0, time.monotonic(), _Brake(options.stop_after_s)
    for file in (path, options.out / "truth.jsonl"):
        end_line(file)
    truths = (options.out / "truth.jsonl").open("a")
    with truths, path.open("a") as answers:
        for sealed, entry in _answers(todo, options, brake):
            truths.write(json.dumps(sealed) + "\n")
            truths.flush()
            answers.write(json.dumps(entry) + "\n")
            answers.flush()
            count += 1
            if count % 50 == 0:
                spent = time.monotonic() - begin
                print(f"{count}/{len(todo)} in {spent:.0f} s", file=sys.stderr, flush=True)
    brake.release()
    return count
