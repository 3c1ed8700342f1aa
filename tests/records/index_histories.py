"""Random histories of a folder of runs: whatever happens to it, the list of runs is the truth.

Runs are added, copied in, moved, changed by hand and deleted; the index is deleted and damaged;
processes that update it are killed with -9; two processes list at once. After every step the list
is held against what the folders say, read by code of its own: `make campaigns` walks through many.
"""

import json
import os
import random
import shutil
import tempfile
import time
from functools import partial
from pathlib import Path

from forked import forked

from hdbench.records.runindex import INDEX_NAME, list_runs

# a summary counts as settled 20 ms after the last change in place of 2 s: file systems of Linux
# date changes in steps of at most 10 ms, and a history would else never use what the index keeps
_list_runs = partial(list_runs, clock_ns=lambda: time.time_ns() + 1_980_000_000)
_LONGEST_PAUSE_S = 0.04
_STATUS = ("complete", "incomplete", "aborted")
_VERDICTS = ("nothing-found", "named", "unexplained")


def listed(parent: Path) -> list[tuple[str, ...]]:
    """Return what the list of runs says."""
    runs = _list_runs(parent)
    return [(run.path.name, run.kind, run.status, run.drive, run.verdict) for run in runs]


def truth(parent: Path) -> list[tuple[str, ...]]:
    """Return what the folders say."""
    rows = []
    for folder in sorted(file.parent for file in parent.glob("*/run.json")):
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
    if not list(parent.glob("*/")):
        _add(parent, draw)
    return draw.choice(sorted(parent.glob("*/")))


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


def _killed(parent: Path, draw: random.Random) -> None:
    """Kill a process with -9 while it updates the index."""
    _add(parent, draw)
    time.sleep(_LONGEST_PAUSE_S)  # settled, so that there is something to write

    def update() -> None:
        while True:
            (parent / INDEX_NAME).unlink(missing_ok=True)
            _list_runs(parent)
            _list_runs(parent)

    with forked(update) as process:
        time.sleep(draw.uniform(0.0, 0.03))
        process.kill()


def _two_writers(parent: Path, draw: random.Random) -> None:
    """Let two processes list while runs come, go and change."""

    def several() -> None:
        for _ in range(5):
            _list_runs(parent)

    with forked(several) as one, forked(several) as other:
        for _ in range(3):
            draw.choice((_add, _change, _move))(parent, draw)
    assert (one.returncode, other.returncode) == (0, 0), "processes that listed runs"


_STEPS = (
    *(2 * (_add, _add, _copy, _move, _swap, _change, _change, _change)),
    *(2 * (_delete, _spoil_index, _killed, _two_writers)),
    _damage_run,
)


def run_history(seed: int, steps: int = 15) -> None:
    """Walk through one random history."""
    draw = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        parent = Path(name)
        for _ in range(5):
            _add(parent, draw)
        for number in range(steps):
            step = draw.choice(_STEPS)
            step(parent, draw)
            place = f"history {seed}, step {number} ({step.__name__})"
            for _ in range(2):  # the second call finds what the first one kept
                assert listed(parent) == truth(parent), place
                time.sleep(draw.uniform(0.0, _LONGEST_PAUSE_S))
