"""Hold `hdbench batch` against the single command: workers killed, Ctrl-C, twice, wall time.

    tools/batch_campaign.py workers kill cluster twice stop --records 2000 --out build/batch
    tools/batch_campaign.py single --out build/batch       # meanwhile, in another terminal

`workers` takes the wall time with `--workers` workers here, `cluster` with three that are started
by hand. `kill` kills a worker with -9 every `--every` seconds. `twice` runs the batch of `workers`
again. `stop` sends Ctrl-C at ten random moments and goes on with --resume. Every result of each is
compared with that of the single command, which `single` computes beforehand. The overhead is what
a worker does not spend in the command, as a share of what it does. Records are those of `python
tools/blind/null.py`. A part that was interrupted goes on where it was. Prints one line of JSON for
each part and exits 1 where one does not hold.
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
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import psutil

sys.path.insert(0, str(Path(__file__).parent / "blind"))
from null import NOISES, clean_record

from hdbench.records import Trace, write_trace
from hdbench_cli.main import _run as run_line
from hdbench_cli.output import Output

_HDBENCH = (sys.executable, "-m", "hdbench_cli")
_DASK = (sys.executable, "-m", "dask")
_FULL_RATE_HZ = 1000
_HASH = re.compile(rb"sha256 [0-9a-f]{64}")
_STOPS = 10
_SECOND_SHARE = 0.05
_MOST_OVERHEAD = 0.1


class Campaign:
    """Records of one size, and where everything is kept."""

    def __init__(self, args: argparse.Namespace) -> None:
        self.command, self.every, self.workers = args.command, args.every, args.workers
        self.options = args.option or (["--no-report"] if args.command == "run-ripple" else [])
        self.out = args.out.absolute()
        self.traces = self.out / f"traces-{args.seconds:g}s-{args.rate}hz-{args.records}"
        self.rng = random.Random(args.seed)
        self.inputs = [self.traces / f"trace-{k:05d}.csv" for k in range(args.records)]
        self._single = self.out / f"single-{args.command}.jsonl"
        self._make_traces(args.seconds, _FULL_RATE_HZ // args.rate)

    def _make_traces(self, seconds: float, step: int) -> None:
        self.traces.mkdir(parents=True, exist_ok=True)
        for number, file in enumerate(self.inputs):
            if not file.exists():
                made = self.out / f"part-{os.getpid()}.csv"
                record = clean_record(number, seconds, NOISES[number % len(NOISES)])
                columns = {name: values[::step] for name, values in record.columns.items()}
                write_trace(made, Trace(columns))
                made.rename(file)

    def place(self, part: str) -> Path:
        """Return the folder of a batch."""
        return self.out / f"{part}-{self.command}"

    def words(self, part: str, *more: str) -> list[str]:
        """Return the command line of a batch; it goes on with what an earlier call left."""
        folder = self.place(part)
        resume = ("--resume",) if (folder / "batch.jsonl").exists() else ()
        out = ["--out", str(folder), *self.options, *resume, *more]
        return [*_HDBENCH, "batch", self.command, str(self.traces), *out]

    def error_file(self, part: str) -> Path:
        """Return the file with what a batch writes on stderr."""
        return self.out / f"{part}-{self.command}.stderr.txt"

    def start(self, part: str, *more: str) -> subprocess.Popen[str]:
        """Start a batch in a process group of its own, as a terminal does."""
        with self.error_file(part).open("a") as error:
            return subprocess.Popen(
                self.words(part, *more),
                stdout=subprocess.DEVNULL,
                stderr=error,
                text=True,
                start_new_session=True,
            )

    def timed(self, part: str, *more: str) -> dict[str, Any]:
        """Run a batch to its end; return wall time, exit code, and what is true of the results."""
        before, begin = self._journal_lines(part), time.monotonic()
        code = self.start(part, *more).wait()
        wall_s = time.monotonic() - begin
        rows = self._journal_lines(part)[len(before) :]
        return {"wall_s": round(wall_s, 1), "computed": len(rows), **self.check(part, code)}

    def _journal_lines(self, part: str) -> list[str]:
        with suppress(FileNotFoundError):
            return (self.place(part) / "batch.jsonl").read_text().splitlines()[1:]
        return []

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
        """Return the digest of what the single command makes of every record; each made once."""
        lines = self._single.read_text().splitlines() if self._single.exists() else []
        known = dict(json.loads(line) for line in lines)
        for file in self.inputs:
            if file.name not in known:
                known[file.name] = self._one(file)
                with self._single.open("a") as kept:
                    kept.write(json.dumps([file.name, known[file.name]]) + "\n")
        return known

    def _one(self, file: Path) -> str:
        folder = self.out / f"single-{os.getpid()}"
        given = ["--from"] if self.command != "diagnose" else []
        words = [self.command, *given, str(file), "--out", str(folder), *self.options]
        try:
            with redirect_stdout(io.StringIO()):
                run_line(words, Output(json=True))
            return digest(next(folder.iterdir()))
        finally:
            shutil.rmtree(folder, ignore_errors=True)


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


def overhead(rows: Sequence[dict[str, Any]], wall_s: float, workers: int) -> float:
    """Return the time that workers did not spend in the command, as a share of that in it."""
    return wall_s * workers / sum(float(row["seconds"]) for row in rows) - 1.0


def is_worker(process: psutil.Process) -> bool:
    """Say whether a process is a worker of a batch; one that ended meanwhile is none."""
    with suppress(psutil.Error):
        return "spawn_main" in " ".join(process.cmdline())
    return False


def single(campaign: Campaign) -> dict[str, Any]:
    """Run the single command on every record, in one process."""
    begin, cpu = time.monotonic(), time.process_time()
    found = len(campaign.single())
    times = {"wall_s": time.monotonic() - begin, "cpu_s": time.process_time() - cpu}
    return {
        **{name: round(value, 1) for name, value in times.items()},
        "results": found, "holds": found == len(campaign.inputs),
    }  # fmt: skip


def workers(campaign: Campaign) -> dict[str, Any]:
    """Take the wall time with workers on this computer."""
    count = campaign.workers
    part = f"workers-{count}"
    found = campaign.timed(part, "--workers", str(count))
    if found["computed"] < len(campaign.inputs):  # an earlier call did some: no time of the whole
        return {"workers": count, **found}
    share = overhead(rows_of(campaign.place(part)), found["wall_s"], count)
    holds = found["holds"] and share <= _MOST_OVERHEAD
    return {"workers": count, **found, "overhead": round(share, 4), "holds": holds}


def twice(campaign: Campaign) -> dict[str, Any]:
    """Run the batch of `workers` again, and once more without its results."""
    part = f"workers-{campaign.workers}"
    words = ("--workers", str(campaign.workers))
    if not (campaign.place(part) / "batch.csv").exists():
        campaign.timed(part, *words)
    first_s = sum(float(row["seconds"]) for row in rows_of(campaign.place(part)))
    table = (campaign.place(part) / "batch.csv").read_bytes()
    second = campaign.timed(part, *words)
    same = (campaign.place(part) / "batch.csv").read_bytes() == table
    share = second["wall_s"] * campaign.workers / first_s
    holds = second["holds"] and second["computed"] == 0 and share <= _SECOND_SHARE and same
    return {**second, "share_of_first": round(share, 4), "same_table": same, "holds": holds}


def kill(campaign: Campaign) -> dict[str, Any]:
    """Kill a worker every few seconds."""
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
    shutil.rmtree(campaign.place("stop"), ignore_errors=True)
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
    with cluster_by_hand(campaign.out / f"scheduler-{campaign.command}") as address:
        return campaign.timed("cluster", "--scheduler", address)


PARTS: dict[str, Callable[[Campaign], dict[str, Any]]] = {
    "single": single, "workers": workers, "twice": twice, "kill": kill, "stop": stop,
    "cluster": cluster,
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
    parser.add_argument(
        "--rate", type=int, default=_FULL_RATE_HZ, choices=[1000, 500, 200, 100], help="Hz"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--every", type=float, default=10.0, help="s between two kills")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build") / "batch")
    args = parser.parse_args()
    campaign, holds = Campaign(args), True
    for name in args.parts:
        found = PARTS[name](campaign)
        holds = holds and found["holds"]
        size = {"part": name, "command": args.command, "records": args.records}
        of = {"seconds": args.seconds, "rate_hz": args.rate}
        print(json.dumps({**size, **of, **found}), flush=True)
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
