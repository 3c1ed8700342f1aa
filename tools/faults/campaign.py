"""The fault campaign: break what can be broken on one Linux computer, and print what happened.

Usage: python tools/faults/campaign.py [--share 0.05] [--rows 1,2,4] [--record rows.jsonl]
       [--write docs/reliability.md]

`--share 1` is the whole campaign: 300 signals, 200 kills, 50 freezes, and so on. Every row is
printed as it ends: fault, trials, how many went as required, worst time until the motor stands,
acknowledged samples lost. With `--record` it goes on where it was broken off, on the same version.
Exits 1 where a trial did not go as required.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict
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


def campaign(share: float, numbers: set[str], seed: int, folder: Path, record: Record) -> list[Row]:
    """Run the rows asked for that are not recorded yet, `share` of their trials each."""
    asked = {entry[0] for entry in (*ON_BENCH, *ALONE) if not numbers or entry[0] in numbers}
    left = asked - {row.number for row in record.rows}
    on_bench = [entry for entry in ON_BENCH if entry[0] in left]
    if on_bench:
        profile = short_profile(folder)
        with served(folder, profile) as bench:
            for _, trials, run in on_bench:
                record.keep(_told(partial(run, folder, bench, profile, _n(trials, share), seed)))
    for number, trials, alone in ALONE:
        if number in left:
            record.keep(_told(partial(alone, folder, _n(trials, share), seed)))
    found = [row for row in record.rows if row.number in asked]
    return sorted(found, key=lambda row: int(row.number))


class Record:
    """Rows of one version in a file, a line each: a campaign that was broken off goes on there.

    Parameters
    ----------
    path : Path or None
        The file; None keeps nothing.
    version : str
        What is tried; rows of other versions in the file are left alone.
    """

    def __init__(self, path: Path | None, version: str) -> None:
        self.version = version
        self.rows: list[Row] = []
        self._path = path
        if path is not None and path.exists():
            lines = map(json.loads, path.read_text().splitlines())
            self.rows = [Row(**line["row"]) for line in lines if line["version"] == version]

    def keep(self, row: Row) -> None:
        """Add a row."""
        self.rows.append(row)
        if self._path is not None:
            with self._path.open("a") as file:
                file.write(json.dumps({"version": self.version, "row": asdict(row)}) + "\n")


def _n(trials: int, share: float) -> int:
    return max(3, round(trials * share))


def _told(run: Callable[[], Row]) -> Row:
    start_s = time.monotonic()
    row = run()
    print(_line(row), f"[{time.monotonic() - start_s:.0f} s]", flush=True)
    for problem in row.bad[:5]:
        print(f"      {problem}", flush=True)
    return row


def _line(row: Row, *more: str) -> str:
    stop = "-" if row.worst_stop_s is None else f"{row.worst_stop_s:.2f}"
    lost = "-" if row.lost is None else str(row.lost)
    notes = ", ".join(f"{key}: {value}" for key, value in row.notes.items())
    cells = (row.number, row.fault, *more, row.trials, row.good, stop, lost, notes)
    return f"| {' | '.join(map(str, cells))} |"


def table(rows: list[Row], version: str) -> str:
    """Return the table with date and computer; each row names its version."""
    today = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d")
    system = f"{platform.system()} {platform.release()}"
    return "\n".join(
        [
            BEGIN,
            f"{today}, {system}, {os.cpu_count()} cores shared with other work.",
            "",
            "| fault | done | version | trials | as required | worst time to standstill, s | "
            "acknowledged samples lost | counted |",
            "|---|---|---|---|---|---|---|---|",
            *(_line(row, version) for row in rows),
            END,
        ]
    )


def _version() -> str:
    """Return the commit of this checkout, marked where something is not committed."""
    words = ["git", "describe", "--always", "--dirty", "--exclude=*"]
    told = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    return told.stdout.strip() or "unknown"


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
    parser.add_argument("--record", type=Path, help="file of finished rows; those are not repeated")
    parser.add_argument("--version", help="what is tried; the commit by default")
    asked = parser.parse_args()
    if asked.minutes is not None:
        os.environ["HDBENCH_FAULT_MINUTES"] = str(asked.minutes)
    rows = {word for word in asked.rows.split(",") if word}
    with tempfile.TemporaryDirectory(prefix="hdbench-faults-") as temporary:
        record = Record(asked.record, asked.version or _version())
        found = campaign(asked.share, rows, asked.seed, asked.keep or Path(temporary), record)
    text = table(found, record.version)
    print(text)
    if asked.write:
        _write(asked.write, text)
    return int(any(row.good < row.trials for row in found))


if __name__ == "__main__":
    sys.exit(main())
