"""The fault campaign: break what can be broken on one Linux computer, and print what happened.

Usage: python tools/faults/campaign.py [--share 0.05] [--rows 1,2,4] [--write docs/reliability.md]

`--share 1` is the whole campaign: 300 signals, 200 kills, 50 freezes, and so on. Every row is
printed as it ends: fault, trials, how many went as required, worst time until the motor stands,
acknowledged samples lost. Exits 1 where a trial did not go as required.
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from faults import answers, disk, inputs, people, process, samples, wire
from faults.kit import Row, ServedBench, served, short_profile

ROOT = Path(__file__).parents[2]
BEGIN, END = "<!-- campaign -->", "<!-- end of campaign -->"
Trial = Callable[[Path, ServedBench, Path, int, int], Row]


def _kills(folder: Path, bench: ServedBench, profile: Path, trials: int, seed: int) -> Row:
    resumes = max(1, trials // 10)
    return process.kills(folder, bench, profile, trials, seed, resumes=resumes)


# number, trials of the whole campaign, what does it
ON_BENCH: tuple[tuple[str, int, Trial], ...] = (
    ("1", 300, process.signals),
    ("2", 200, _kills),
    ("3", 50, process.lost_guards),
    ("4", 50, process.freezes),
    ("20", 20, process.limits),
    ("23", 100, process.races),
    ("28", 150, process.load),
)
ALONE: tuple[tuple[str, int, Callable[[Path, int, int], Row]], ...] = (
    ("5", 10_000, disk.power_cuts),
    ("6", 200, disk.full_disks),
    ("7", 500, disk.failing_disks),
    ("8", 6, disk.refusals),
    ("9", 10_000, wire.wrong_headers),
    ("10", 10_000, wire.wrong_replies),
    ("11", 10_000, wire.disorder),
    ("12", 10_000, wire.noise),
    ("13", 10_000, wire.pieces),
    ("14", 200, wire.slow_replies),
    ("15", 1000, wire.cuts),
    ("16", 1000, answers.refusals),
    ("17", 200, answers.waits),
    ("18", 1000, wire.gaps),
    ("19", 600, samples.broken_channels),
    ("21", 40, people.clock_steps),
    ("22", 1320, answers.wraps),
    ("24", 60, people.people),
    ("25", 10_000, inputs.profiles),
    ("26", 10_000, inputs.traces),
    ("27", 100, disk.killed_writes),
)


def campaign(share: float, rows: set[str], seed: int, folder: Path) -> list[Row]:
    """Run the rows asked for, `share` of their trials each, and print them as they end."""
    done: list[Row] = []
    asked = [entry for entry in ON_BENCH if not rows or entry[0] in rows]
    if asked:
        profile = short_profile(folder)
        with served(folder, profile) as bench:
            for _, trials, run in asked:
                count = _n(trials, share)
                done.append(_told(partial(run, folder, bench, profile, count, seed)))
    for number, trials, alone in ALONE:
        if not rows or number in rows:
            done.append(_told(partial(alone, folder, _n(trials, share), seed)))
    return sorted(done, key=lambda row: int(row.number))


def _n(trials: int, share: float) -> int:
    return max(3, round(trials * share))


def _told(run: Callable[[], Row]) -> Row:
    start_s = time.monotonic()
    row = run()
    print(_line(row), f"[{time.monotonic() - start_s:.0f} s]", flush=True)
    for problem in row.bad[:5]:
        print(f"      {problem}", flush=True)
    return row


def _line(row: Row) -> str:
    stop = "-" if row.worst_stop_s is None else f"{row.worst_stop_s:.2f}"
    lost = "-" if row.lost is None else str(row.lost)
    notes = ", ".join(f"{key}: {value}" for key, value in row.notes.items())
    return f"| {row.number} | {row.fault} | {row.trials} | {row.good} | {stop} | {lost} | {notes} |"


def table(rows: list[Row], share: float) -> str:
    """Return the table with date, commit and computer."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    ).stdout.strip()
    today = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d")
    head = (
        f"{today}, commit {commit} and what was not yet committed, share {share:g} of the whole "
        f"campaign, "
        f"{platform.system()} {platform.release()}, {os.cpu_count()} cores shared with other work."
    )
    return "\n".join(
        [
            BEGIN,
            head,
            "",
            "| fault | done | trials | as required | worst time to standstill, s | acknowledged "
            "samples lost | counted |",
            "|---|---|---|---|---|---|---|",
            *map(_line, rows),
            END,
        ]
    )


def _write(path: Path, text: str) -> None:
    page = path.read_text()
    before, _, rest = page.partition(BEGIN)
    after = rest.partition(END)[2]
    path.write_text(f"{before}{text}{after}")


def main() -> int:
    """Run the campaign; 0 where every trial went as required."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--share", type=float, default=0.05, help="of the whole campaign")
    parser.add_argument("--rows", default="", help="numbers, comma separated; all by default")
    parser.add_argument("--minutes", type=float, help="longest time of a row on the bench")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", type=Path, help="page whose table is replaced")
    parser.add_argument("--keep", type=Path, help="folder for everything that the runs leave")
    asked = parser.parse_args()
    if asked.minutes is not None:
        os.environ["HDBENCH_FAULT_MINUTES"] = str(asked.minutes)
    rows = {word for word in asked.rows.split(",") if word}
    with tempfile.TemporaryDirectory(prefix="hdbench-faults-") as temporary:
        found = campaign(asked.share, rows, asked.seed, asked.keep or Path(temporary))
    text = table(found, asked.share)
    print(text)
    if asked.write:
        _write(asked.write, text)
    return int(any(row.good < row.trials for row in found))


if __name__ == "__main__":
    sys.exit(main())
