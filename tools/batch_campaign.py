"""Hold `hdbench batch` against the single command: workers killed, Ctrl-C, twice, wall time.

    tools/batch_campaign.py kill stop twice cluster --records 2000 --seconds 20 --out build/batch

`kill` kills a worker with -9 every `--every` seconds, and compares every result with that of the
single command. `stop` sends Ctrl-C at ten random moments, goes on with --resume, and compares the
table with that of a batch that nobody stopped. `twice` runs the same batch again. `cluster` takes
the wall time with one and two workers and with three workers started by hand; the overhead is what
a worker does not spend in the command itself, and stands beside each. Records are those of
`python tools/blind/null.py`. Prints one line of JSON each and exits 1 where one does not hold.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout, suppress
from pathlib import Path
from typing import Any

import psutil

sys.path.insert(0, str(Path(__file__).parent / "blind"))
from null import NOISES, clean_record

from hdbench.records import write_trace
from hdbench_cli.main import _run as run_line
from hdbench_cli.output import Output

_HDBENCH = (sys.executable, "-m", "hdbench_cli")
_STOPS = 10
_SECOND_SHARE = 0.05


class Campaign:
    """Records of one size, and where everything is kept."""

    def __init__(self, args: argparse.Namespace) -> None:
        self.command, self.every = args.command, args.every
        self.options = args.option or (["--no-report"] if args.command == "run-ripple" else [])
        self.workers, self.out = str(args.workers), args.out
        self.traces = args.out / f"traces-{args.seconds:g}s-{args.records}"
        self.rng = random.Random(args.seed)
        self.inputs = [self.traces / f"trace-{k:05d}.csv" for k in range(args.records)]
        self.traces.mkdir(parents=True, exist_ok=True)
        for number, file in enumerate(self.inputs):
            if not file.exists():
                kind = NOISES[number % len(NOISES)]
                write_trace(file, clean_record(number, args.seconds, kind))

    def words(self, name: str, *more: str) -> list[str]:
        """Return the command line of a batch in a folder of its own."""
        out = ["--out", str(self.out / name), *self.options, *more]
        return [*_HDBENCH, "batch", self.command, str(self.traces), *out]

    def clear(self, name: str) -> Path:
        """Return an empty folder for a batch."""
        shutil.rmtree(self.out / name, ignore_errors=True)
        return self.out / name

    def start(self, words: Sequence[str]) -> subprocess.Popen[str]:
        """Start a batch in a process group of its own, as a terminal does."""
        error = (self.out / "stderr.txt").open("a")
        return subprocess.Popen(
            words, stdout=subprocess.DEVNULL, stderr=error, text=True, start_new_session=True
        )

    def timed(self, name: str, *more: str) -> tuple[float, int]:
        """Run a batch to its end; return wall time, s, and exit code."""
        begin = time.monotonic()
        code = self.start(self.words(name, *more)).wait()
        return time.monotonic() - begin, code

    def whole(self) -> Path:
        """Return a batch that nobody disturbed; made once."""
        folder = self.out / "whole"
        if not (folder / "batch.csv").exists():
            self.clear("whole")
            self.timed("whole", "--workers", self.workers)
        return folder


def rows_of(folder: Path) -> list[dict[str, str]]:
    """Return the table of a batch."""
    with (folder / "batch.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def same_table(one: Path, other: Path) -> bool:
    """Say whether two tables hold the same rows; time and folder are their own."""

    def plain(folder: Path) -> list[dict[str, str]]:
        rows = rows_of(folder)
        own = {"seconds": ""}
        return [row | own | {"result": Path(row["result"]).name} for row in rows]

    return plain(one) == plain(other)


def result_of(run: Path) -> dict[str, Any]:
    """Return a result without the name of its run, which is a time."""
    body: dict[str, Any] = json.loads((run / "result.json").read_text())
    body.pop("run", None)
    return body


def overhead(folder: Path, wall_s: float, workers: int) -> float:
    """Return the time that workers did not spend in the command, as a share of that in it."""
    inside_s = sum(float(row["seconds"]) for row in rows_of(folder))
    return wall_s * workers / inside_s - 1.0


def is_worker(process: psutil.Process) -> bool:
    """Say whether a process is a worker of a batch; one that ended meanwhile is none."""
    with suppress(psutil.Error):
        return "spawn_main" in " ".join(process.cmdline())
    return False


def kill(campaign: Campaign) -> dict[str, Any]:
    """Kill a worker every few seconds; compare every result with the single command's."""
    folder = campaign.clear("kill")
    batch = campaign.start(campaign.words("kill", "--workers", campaign.workers, "--retries", "10"))
    parent, kills, begin = psutil.Process(batch.pid), 0, time.monotonic()
    while batch.poll() is None:
        try:
            batch.wait(campaign.every)
        except subprocess.TimeoutExpired:
            workers = [child for child in parent.children() if is_worker(child)]
            if workers:
                campaign.rng.choice(workers).kill()
                kills += 1
    wall_s = time.monotonic() - begin
    rows, different = rows_of(folder), 0
    for row, file in zip(rows, campaign.inputs, strict=False):
        if not row["result"]:
            continue
        alone = campaign.clear("single")
        words = [campaign.command, "--from", str(file.absolute()), "--out", str(alone)]
        if campaign.command == "diagnose":
            words.remove("--from")
        with redirect_stdout(io.StringIO()):
            run_line([*words, *campaign.options], Output(json=True))
        single = next(alone.iterdir())
        different += Path(row["input"]) != file or (
            result_of(single) != result_of(folder / "results" / Path(row["result"]).name)
        )
    found = len(list((folder / "results").iterdir()))
    holds = batch.returncode == different == 0 and len(rows) == found == len(campaign.inputs)
    return {
        "kills": kills, "wall_s": round(wall_s, 1), "results": found, "different": different,
        "exit_code": batch.returncode, "holds": holds,
    }  # fmt: skip


def stop(campaign: Campaign) -> dict[str, Any]:
    """Send Ctrl-C at ten random moments, go on, and compare the table."""
    begin = time.monotonic()
    whole = campaign.whole()
    whole_s = max(20.0, time.monotonic() - begin)
    folder, codes, slowest, stopped = campaign.clear("stop"), [], 0.0, 0
    for number in range(_STOPS):
        resume = ("--resume",) if (folder / "batch.jsonl").exists() else ()
        batch = campaign.start(campaign.words("stop", "--workers", campaign.workers, *resume))
        try:
            batch.wait(campaign.rng.uniform(0.5, 2.0 * whole_s / _STOPS))
        except subprocess.TimeoutExpired:
            os.killpg(batch.pid, signal.SIGINT)
            pressed = time.monotonic()
            batch.wait()
            slowest, stopped = max(slowest, time.monotonic() - pressed), number + 1
        codes.append(batch.returncode)
    _, last = campaign.timed("stop", "--workers", campaign.workers, "--resume")
    same = same_table(whole, folder)
    clean = "Traceback" not in (campaign.out / "stderr.txt").read_text()
    holds = same and clean and last == 0 and set(codes) <= {0, 130, -signal.SIGINT}
    return {
        "stopped": stopped, "exit_codes": codes, "slowest_stop_s": round(slowest, 1),
        "same_table": same, "no_traceback": clean, "holds": holds,
    }  # fmt: skip


def twice(campaign: Campaign) -> dict[str, Any]:
    """Run a batch and then the same again."""
    campaign.clear("twice")
    first_s, _ = campaign.timed("twice", "--workers", campaign.workers)
    before = (campaign.out / "twice" / "batch.jsonl").read_bytes()
    second_s, code = campaign.timed("twice", "--workers", campaign.workers, "--resume")
    nothing = (campaign.out / "twice" / "batch.jsonl").read_bytes() == before
    share = second_s / first_s
    return {
        "first_s": round(first_s, 2), "second_s": round(second_s, 2), "share": round(share, 4),
        "nothing_computed": nothing, "holds": nothing and code == 0 and share <= _SECOND_SHARE,
    }  # fmt: skip


def cluster(campaign: Campaign) -> dict[str, Any]:
    """Take the wall time with one and two workers, and with three started by hand."""
    found: dict[str, Any] = {}
    for count in (1, 2):
        folder = campaign.clear(f"workers-{count}")
        wall_s, _ = campaign.timed(folder.name, "--workers", str(count))
        share = round(overhead(folder, wall_s, count), 4)
        found[f"workers_{count}"] = {"wall_s": round(wall_s, 1), "overhead": share}
    dask = (sys.executable, "-m", "dask")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    place = campaign.clear("scheduler")
    place.mkdir()
    file = str(place / "scheduler.json")
    hands = [
        subprocess.Popen(
            [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
             "--scheduler-file", file], **quiet
        )
    ]  # fmt: skip
    try:
        while not Path(file).exists():
            time.sleep(0.2)
        address = json.loads(Path(file).read_text())["address"]
        for _ in range(3):
            hands.append(
                subprocess.Popen([*dask, "worker", address, "--nthreads", "1",
                                  "--no-dashboard"], cwd=place, **quiet)
            )  # fmt: skip
        folder = campaign.clear("cluster")
        wall_s, code = campaign.timed("cluster", "--scheduler", address)
    finally:
        for process in reversed(hands):
            process.terminate()
            process.wait()
    found["cluster_3"] = {"wall_s": round(wall_s, 1), "exit_code": code}
    same = same_table(folder, campaign.out / "workers-1")
    return {**found, "same_table": same, "holds": code == 0 and same}


PARTS: dict[str, Callable[[Campaign], dict[str, Any]]] = {
    "kill": kill, "stop": stop, "twice": twice, "cluster": cluster,
}  # fmt: skip


def main() -> int:
    """Run the parts that were named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="+", choices=list(PARTS))
    parser.add_argument("--command", default="run-ripple", choices=["run-ripple", "diagnose"])
    parser.add_argument("--option", action="append", help="of the command; may be repeated")
    parser.add_argument("--records", type=int, default=2000)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--every", type=float, default=10.0, help="s between two kills")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build") / "batch")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "stderr.txt").write_text("")
    campaign, holds = Campaign(args), True
    for name in args.parts:
        found = PARTS[name](campaign)
        holds = holds and found["holds"]
        size = {"part": name, "command": args.command, "records": args.records}
        print(json.dumps({**size, "seconds": args.seconds, **found}), flush=True)
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
