"""Random histories of a folder of runs: whatever happens to it, the list of runs is the truth.

Runs are added, copied in, moved, changed by hand and deleted; the index is deleted and damaged;
processes that update it are killed with -9; two processes list at once. After every step the list
is held against what the folders say, read by code of its own: `make campaigns` walks through many.
"""

import json
import os
import random
import shutil
import signal
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from hdbench.records.runindex import INDEX_NAME, list_runs

# a summary counts as settled 20 ms after the last change in place of 2 s: file systems of Linux
# date changes in steps of at most 10 ms, and a history would else never use what the index keeps
_AHEAD_NS = 1_980_000_000
_LONGEST_PAUSE_S = 0.04
_STATUS = ("complete", "incomplete", "aborted")
_VERDICTS = ("nothing-found", "named", "unexplained")

Row = tuple[str, str, str, str, str]


def _clock_ns() -> int:
    return time.time_ns() + _AHEAD_NS


def listed(parent: Path) -> list[Row]:
    """Return what the list of runs says."""
    runs = list_runs(parent, clock_ns=_clock_ns)
    return [(run.path.name, run.kind, run.status, run.drive, run.verdict) for run in runs]


def truth(parent: Path) -> list[Row]:
    """Return what the folders say."""
    rows = []
    for folder in sorted(parent.iterdir()):
        if not (folder / "run.json").exists():
            continue
        try:
            run = json.loads((folder / "run.json").read_text())
        except ValueError:
            rows.append((folder.name, "", "invalid", "", ""))
            continue
        file = folder / "result.json"
        verdict = json.loads(file.read_text())["verdict"] if file.exists() else ""
        rows.append((folder.name, run["kind"], run["status"], run["drive"], verdict))
    return rows


def _run(draw: random.Random) -> str:
    body = {"schema": "hdbench/run/1", "kind": "diagnosis", "files": {}, "profile": {"name": "p"}}
    body |= {"status": draw.choice(_STATUS), "drive": f"D{draw.randrange(10)}"}
    return json.dumps(body)


def _result(draw: random.Random) -> str:
    return json.dumps({"verdict": draw.choice(_VERDICTS)})


def _add(parent: Path, draw: random.Random) -> None:
    folder = parent / f"2026-diagnosis-{draw.randrange(10**6):06d}"
    folder.mkdir(exist_ok=True)
    (folder / "run.json").write_text(_run(draw))
    if draw.random() < 0.8:
        (folder / "result.json").write_text(_result(draw))


def _pick(parent: Path, draw: random.Random) -> Path:
    folders = sorted(path for path in parent.iterdir() if path.is_dir())
    if not folders:
        _add(parent, draw)
        return _pick(parent, draw)
    return draw.choice(folders)


def _copy(parent: Path, draw: random.Random) -> None:
    # with the times of the original, as cp -a does
    target = parent / f"2026-copy-{draw.randrange(10**6):06d}"
    if not target.exists():
        shutil.copytree(_pick(parent, draw), target)


def _move(parent: Path, draw: random.Random) -> None:
    _pick(parent, draw).rename(parent / f"2026-moved-{draw.randrange(10**9):09d}")


def _swap(parent: Path, draw: random.Random) -> None:
    a, b = _pick(parent, draw), _pick(parent, draw)
    if a != b:
        a.rename(parent / "swap")
        b.rename(a)
        (parent / "swap").rename(b)


def _change(parent: Path, draw: random.Random) -> None:
    name, text = draw.choice((("run.json", _run), ("result.json", _result)))
    file = _pick(parent, draw) / name
    old = file.stat() if file.exists() else None
    if draw.random() < 0.5:
        file.write_text(text(draw))  # in place: the same file, often the same size
    else:
        file.with_name("new").write_text(text(draw))
        file.with_name("new").replace(file)
    if old is not None and draw.random() < 0.5:
        os.utime(file, ns=(old.st_atime_ns, old.st_mtime_ns))  # as if it had not been touched


def _damage_run(parent: Path, draw: random.Random) -> None:
    (_pick(parent, draw) / "run.json").write_text("{")


def _delete(parent: Path, draw: random.Random) -> None:
    folder = _pick(parent, draw)
    if draw.random() < 0.5:
        shutil.rmtree(folder)
    else:
        (folder / draw.choice(("run.json", "result.json"))).unlink(missing_ok=True)


def _spoil_index(parent: Path, draw: random.Random) -> None:
    file = parent / INDEX_NAME
    if not file.exists():
        return
    how = draw.randrange(4)
    if how == 0:
        file.unlink()
    elif how == 1:
        os.truncate(file, draw.randrange(file.stat().st_size + 1))
    else:
        with file.open("r+b") as stream:
            stream.seek(draw.randrange(max(1, file.stat().st_size)) if how == 2 else 0)
            stream.write(draw.randbytes(200))


def _child(work: Callable[[], object]) -> int:
    """Run `work` in a process of its own; return its number."""
    process = os.fork()
    if process == 0:
        code = 1
        try:
            work()
            code = 0
        finally:
            os._exit(code)
    return process


def _killed(parent: Path, draw: random.Random) -> None:
    """Kill a process with -9 while it updates the index."""
    _add(parent, draw)
    time.sleep(_LONGEST_PAUSE_S)  # settled, so that there is something to write

    def update() -> None:
        while True:
            (parent / INDEX_NAME).unlink(missing_ok=True)
            list_runs(parent, clock_ns=_clock_ns)
            list_runs(parent, clock_ns=_clock_ns)

    process = _child(update)
    time.sleep(draw.uniform(0.0, 0.03))
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)


def _two_writers(parent: Path, draw: random.Random) -> None:
    """Let two processes list while runs come, go and change."""

    def several() -> None:
        for _ in range(5):
            list_runs(parent, clock_ns=_clock_ns)

    children = [_child(several), _child(several)]
    for _ in range(3):
        draw.choice((_add, _change, _move))(parent, draw)
    for process in children:
        _, status = os.waitpid(process, 0)
        if status:
            raise AssertionError(f"a process that listed runs ended with {status}")


_STEPS = (
    (_add, 4),
    (_copy, 2),
    (_move, 2),
    (_swap, 2),
    (_change, 6),
    (_damage_run, 1),
    (_delete, 2),
    (_spoil_index, 2),
    (_killed, 2),
    (_two_writers, 2),
)


def run_history(seed: int, steps: int = 15) -> None:
    """Walk through one random history."""
    draw = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        parent = Path(name)
        for _ in range(5):
            _add(parent, draw)
        for number in range(steps):
            step = draw.choices([s for s, _ in _STEPS], [weight for _, weight in _STEPS])[0]
            step(parent, draw)
            place = f"history {seed}, step {number} ({step.__name__})"
            for _ in range(2):  # the second call finds what the first one kept
                found, real = listed(parent), truth(parent)
                if found != real:
                    raise AssertionError(f"{place}: {found} but {real}")
                time.sleep(draw.uniform(0.0, _LONGEST_PAUSE_S))
