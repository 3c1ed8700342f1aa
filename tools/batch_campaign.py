"""Hold `hdbench batch` against the single command: workers killed, Ctrl-C, twice, wall time.

    python tools/batch_campaign.py workers kill cluster stop --records 2000 --out build/batch

`workers` takes the wall time with `--workers` workers here, and runs the same again, which has to
compute nothing; `cluster` takes it with three workers that are started by hand. `kill` kills a
worker with -9 every `--every` seconds. `stop` sends Ctrl-C at ten random moments and goes on with
--resume. Every result is compared with that of the single command, made once for every record. The
overhead is what a worker does not spend in the command, as a share of what it does. Records are
those of `python tools/blind/null.py`. Prints one line of JSON for each part and exits 1 where one
does not hold.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import psutil

sys.path.insert(0, str(Path(__file__).parent / "blind"))
from null import NOISES, clean_record

from hdbench.records import write_trace
from hdbench_cli.main import _run as run_line
from hdbench_cli.output import Output

_HDBENCH = (sys.executable, "-m", "hdbench_cli")
_DASK = (sys.executable, "-m", "dask")
_HASH = re.compile(rb"sha256 [0-9a-f]{64}")
_STOPS = 10
_AGAIN_SHARE = 0.05
_MOST_OVERHEAD = 0.1


class Campaign:
    """Records of one size, and where everything is kept."""

    def __init__(self, args: argparse.Namespace) -> None:
        self.command, self.every, self.workers = args.command, args.every, args.workers
        self.options = ["--no-report"] if args.command == "run-ripple" else []
        self.out = args.out.absolute()
        self.traces = self.out / f"traces-{args.seconds:g}s-{args.records}"
        self.traces.mkdir(parents=True, exist_ok=True)
        self.rng = random.Random(args.seed)
        self.inputs = [self.traces / f"trace-{k:05d}.csv" for k in range(args.records)]
        for number, file in enumerate(self.inputs):
            if not file.exists():
                record = clean_record(number, args.seconds, NOISES[number % len(NOISES)])
                write_trace(file, record)

    def place(self, part: str) -> Path:
        """Return the folder of a batch."""
        return self.out / f"{part}-{self.command}"

    def error_file(self, part: str) -> Path:
        """Return the file with what a batch writes on stderr."""
        return self.out / f"{part}-{self.command}.stderr.txt"

    def forget(self, part: str) -> None:
        """Remove what an earlier call of a part left."""
        shutil.rmtree(self.place(part), ignore_errors=True)
        self.error_file(part).unlink(missing_ok=True)

    def start(self, part: str, *more: str) -> subprocess.Popen[str]:
        """Start a batch, or go on with it, in a process group of its own, as a terminal does."""
        folder = self.place(part)
        resume = ("--resume",) if (folder / "batch.jsonl").exists() else ()
        out = ["--out", str(folder), *self.options, *resume, *more]
        with self.error_file(part).open("a") as error:
            return subprocess.Popen(
                [*_HDBENCH, "batch", self.command, str(self.traces), *out],
                stdout=subprocess.DEVNULL,
                stderr=error,
                text=True,
                start_new_session=True,
            )

    def timed(self, part: str, *more: str) -> dict[str, Any]:
        """Run a batch to its end; return wall time, exit code, and what is true of the results."""
        begin = time.monotonic()
        code = self.start(part, *more).wait()
        return {"wall_s": round(time.monotonic() - begin, 1), **self.check(part, code)}

    def check(self, part: str, code: int) -> dict[str, Any]:
        """Compare every result of a batch with that of the single command."""
        folder = self.place(part)
        rows = rows_of(folder)
        alone = self.single()
        different = sum(
            row["input"] != str(file)
            or not row["result"]
            or digest(folder / "results" / Path(row["result"]).name) != alone[file.name]
            for row, file in zip(rows, self.inputs, strict=False)
        )
        results = len(list((folder / "results").iterdir()))
        clean = "Traceback" not in self.error_file(part).read_text()
        holds = clean and code == different == 0 and len(rows) == results == len(self.inputs)
        return {
            "rows": len(rows), "results": results, "different": different, "exit_code": code,
            "no_traceback": clean, "holds": holds,
        }  # fmt: skip

    def single(self) -> dict[str, str]:
        """Return the digest of what the single command makes of every record, kept in a file."""
        file = self.traces / f"single-{self.command}.json"
        if not file.exists():
            found = {trace.name: self._one(trace) for trace in self.inputs}
            file.write_text(json.dumps(found))
        kept: dict[str, str] = json.loads(file.read_text())
        return kept

    def _one(self, file: Path) -> str:
        given = ["--from"] if self.command != "diagnose" else []
        with tempfile.TemporaryDirectory() as name, redirect_stdout(io.StringIO()):
            words = [self.command, *given, str(file), "--out", name, *self.options]
            run_line(words, Output(json=True))
            return digest(next(Path(name).iterdir()))


def rows_of(folder: Path) -> list[dict[str, str]]:
    """Return the table of a batch."""
    with (folder / "batch.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def digest(run: Path) -> str:
    """Return the digest of every file in a run but run.json, without what names the run itself."""
    name = json.loads((run / "run.json").read_text())["run_id"].encode()
    total = hashlib.sha256()
    for file in sorted(run.iterdir()):
        content = b"" if file.name == "run.json" else file.read_bytes().replace(name, b"")
        if file.name == "filter.json":  # the hash of a result that holds that name
            content = _HASH.sub(b"", content)
        total.update(file.name.encode() + b" " + hashlib.sha256(content).digest())
    return total.hexdigest()


def is_worker(process: psutil.Process) -> bool:
    """Say whether a process is a worker of a batch; one that ended meanwhile is none."""
    with suppress(psutil.Error):
        return "spawn_main" in " ".join(process.cmdline())
    return False


def workers(campaign: Campaign) -> dict[str, Any]:
    """Take the wall time with workers on this computer, then that of the same call again."""
    count, part = campaign.workers, "workers"
    campaign.forget(part)
    found = campaign.timed(part, "--workers", str(count))
    table = (campaign.place(part) / "batch.csv").read_bytes()
    worked_s = sum(float(row["seconds"]) for row in rows_of(campaign.place(part)))
    second = campaign.timed(part, "--workers", str(count))
    same = (campaign.place(part) / "batch.csv").read_bytes() == table
    over, again = (count * run["wall_s"] / worked_s for run in (found, second))
    holds = found["holds"] and second["holds"] and same
    return {
        "workers": count, **found, "overhead": round(over - 1.0, 4), "again": round(again, 4),
        "same_table": same, "holds": holds and over <= 1 + _MOST_OVERHEAD and again <= _AGAIN_SHARE,
    }  # fmt: skip


def kill(campaign: Campaign) -> dict[str, Any]:
    """Kill a worker every few seconds."""
    campaign.forget("kill")
    batch = campaign.start("kill", "--workers", str(campaign.workers), "--retries", "10")
    parent, kills, begin = psutil.Process(batch.pid), 0, time.monotonic()
    while batch.poll() is None:
        try:
            batch.wait(campaign.every)
        except subprocess.TimeoutExpired:
            hands = [child for child in parent.children() if is_worker(child)]
            if hands:
                campaign.rng.choice(hands).kill()
                kills += 1
    wall_s = round(time.monotonic() - begin, 1)
    return {"kills": kills, "wall_s": wall_s, **campaign.check("kill", batch.returncode)}


def stop(campaign: Campaign) -> dict[str, Any]:
    """Send Ctrl-C at ten random moments, go on, and compare."""
    count = str(campaign.workers)
    campaign.forget("stop")
    codes, slowest, stopped = [], 0.0, 0
    # so that ten stops reach through the whole batch, at the speed at which it goes
    rate, done = 1.0, 0
    while len(codes) < _STOPS:
        left = (len(campaign.inputs) - done) / (_STOPS - len(codes)) / rate
        batch, begin = campaign.start("stop", "--workers", count), time.monotonic()
        try:
            batch.wait(campaign.rng.uniform(0.2, 5.0 + 1.5 * left))
        except subprocess.TimeoutExpired:
            os.killpg(batch.pid, signal.SIGINT)
            pressed = time.monotonic()
            batch.wait()
            slowest, stopped = max(slowest, time.monotonic() - pressed), stopped + 1
        codes.append(batch.returncode)
        with suppress(FileNotFoundError):
            now = len((campaign.place("stop") / "batch.jsonl").read_bytes().splitlines()) - 1
            rate = max((now - done) / (time.monotonic() - begin), 0.2)
            done = now
    found = campaign.timed("stop", "--workers", count)
    holds = found["holds"] and set(codes) <= {0, 130, -signal.SIGINT}
    return {
        "stopped": stopped, "exit_codes": codes, "slowest_stop_s": round(slowest, 1), **found,
        "holds": holds,
    }  # fmt: skip


@contextmanager
def cluster_by_hand(place: Path) -> Iterator[str]:
    """Start a scheduler and three workers, and give its address."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    file = place / "scheduler.json"
    # each as from a terminal of its own
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    quiet["start_new_session"] = True
    head = ("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    hands = [subprocess.Popen([*_DASK, *head, "--scheduler-file", str(file)], **quiet)]
    try:
        while not file.exists():
            time.sleep(0.2)
        address = json.loads(file.read_text())["address"]
        worker = ("worker", address, "--nthreads", "1", "--no-dashboard")
        hands += [subprocess.Popen([*_DASK, *worker], cwd=place, **quiet) for _ in range(3)]
        yield address
    finally:
        for process in reversed(hands):
            process.terminate()
            process.wait()


def cluster(campaign: Campaign) -> dict[str, Any]:
    """Take the wall time with three workers started by hand."""
    campaign.forget("cluster")
    with cluster_by_hand(campaign.out / f"scheduler-{campaign.command}") as address:
        return campaign.timed("cluster", "--scheduler", address)


PARTS: dict[str, Callable[[Campaign], dict[str, Any]]] = {
    "workers": workers, "kill": kill, "stop": stop, "cluster": cluster,
}  # fmt: skip


def main() -> int:
    """Run the parts that were named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="+", choices=list(PARTS))
    parser.add_argument("--command", default="run-ripple", choices=["run-ripple", "diagnose"])
    parser.add_argument("--records", type=int, default=2000)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--every", type=float, default=10.0, help="s between two kills")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build") / "batch")
    args = parser.parse_args()
    campaign, holds = Campaign(args), True
    for name in args.parts:
        found = PARTS[name](campaign)
        holds = holds and found["holds"]
        size = {"command": args.command, "records": args.records, "seconds": args.seconds}
        print(json.dumps({"part": name, **size, **found}), flush=True)
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
