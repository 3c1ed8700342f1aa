"""`hdbench batch`: the single command's results, rows with errors, deaths, Ctrl-C, --resume."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
import swinging_shaft as swinging
from forked import ended

from hdbench.batch import BatchFolder, Input, Outcome, Workers, expand_inputs, stamps_of
from hdbench.batch.workers import _run, _Seats
from hdbench.errors import BusyError, UsageError
from hdbench.records import write_trace
from hdbench_cli.commands.batch_task import run_one

HDBENCH = [sys.executable, "-m", "hdbench_cli"]
# elsewhere a fork may not use what is loaded
METHOD = "forkserver" if sys.platform == "linux" else "spawn"
# what every worker would import for itself
WARM = ["distributed", "hdbench.session", "hdbench_cli.commands.batch_task"]


@pytest.fixture(autouse=True, scope="module")
def _warm_workers() -> Iterator[None]:
    """Let workers that start here be forks of a process that has imported what they need."""
    distributed, dask = (pytest.importorskip(name) for name in ("distributed", "dask"))
    with dask.config.set({"distributed.worker.multiprocessing-method": METHOD}):
        context = distributed.utils.get_mp_context()
        if METHOD == "forkserver":
            context.set_forkserver_preload(WARM)
        yield


def record(path: Path, seed: int, seconds: int = 4) -> Path:
    """Write a motion with ripple."""
    ripple = ((2.0, 0.4, 0.0),)
    motion = (100.0, 60.0, 3.0)
    write_trace(path, swinging.record(motion=motion, ripple=ripple, n=1000 * seconds, seed=seed))
    # older than the moment in which a file may change again unseen
    os.utime(path, (1e9 + seed, 1e9 + seed))
    return path


@pytest.fixture
def traces(tmp_path: Path) -> Path:
    folder = tmp_path / "traces"
    folder.mkdir()
    for seed in range(3):
        record(folder / f"drive-{seed}.csv", seed)
    (folder / "spoilt.csv").write_text("time_s,torque_nm\n0,1\nnot a number\n")
    return folder


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Yield the address of a scheduler whose one worker is a thread here: it imports nothing."""
    from distributed import LocalCluster

    one = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "protocol": "tcp"}
    with LocalCluster(**one, dashboard_address=":0") as cluster:
        yield cluster.scheduler_address


@pytest.fixture
def resumed(scheduler, answer):
    """Return a function that goes on with a batch, for what it tells."""
    return lambda *words: answer("batch", *words, "--scheduler", scheduler, "--resume", code=6)


def table(out: Path) -> list[dict[str, str]]:
    with (out / "batch.csv").open(newline="") as file:
        return [{**row, "seconds": ""} for row in csv.DictReader(file)]


def test_a_batch_is_the_single_command_and_a_broken_input_a_row(
    traces, tmp_path, resumed, hdbench, answer
):
    out = tmp_path / "out"
    words = ["run-ripple", traces, "--no-report", "--out", out]
    body = answer("batch", *words, "--workers", "2", code=6)
    assert (body["done"], body["failed"], body["skipped"]) == (3, 1, 0)
    assert [Path(row["input"]).stem for row in body["rows"]] == [
        "drive-0", "drive-1", "drive-2", "spoilt",
    ]  # fmt: skip
    assert body["rows"][3]["exit_code"] == 4
    assert "spoilt.csv" in body["rows"][3]["error"]
    row = body["rows"][1]
    alone = ["run-ripple", "--from", row["input"], "--no-report", "--out", tmp_path / "alone"]
    hdbench(*alone, code=row["exit_code"])
    single = json.loads(next((tmp_path / "alone").glob("*/result.json")).read_text())
    result = json.loads((Path(row["result"]) / "result.json").read_text())
    assert result | {"run": ""} == single | {"run": ""}
    amplitude = single["ripple"][0]["amplitude_nm"]
    assert row["ripple[order=2].amplitude_nm"] == amplitude["value"]
    assert row["ripple[order=2].amplitude_nm_std"] == amplitude["std"]

    # the same again computes nothing; a changed input and a new option do
    again = resumed(*words)
    assert (again["done"], again["skipped"]) == (0, 3)
    assert again["rows"] == body["rows"]
    journal = (out / "batch.jsonl").read_bytes()
    os.utime(traces / "drive-0.csv", (2e9 - 1e9, 3e8))
    record(traces / "drive-2.csv", 7)
    third = resumed(*words)
    assert (third["done"], third["skipped"]) == (1, 2)
    assert (out / "batch.jsonl").read_bytes().startswith(journal)
    hdbench("batch", *words, code=2)


def test_a_worker_that_dies_is_replaced_and_its_task_run_again(tmp_path):
    script = Path(__file__).with_name("deaths.py")
    words = [sys.executable, str(script), str(tmp_path)]
    env = {**os.environ, "DASK_DISTRIBUTED__WORKER__MULTIPROCESSING_METHOD": METHOD}
    ran = ended(words, env=env)
    assert ran.returncode == 0, ran.stderr
    told = json.loads(ran.stdout)
    values = [value for value, _, _ in told]
    assert values == [0, 10, None, 30, 40], ran.stderr
    assert [deaths for _, deaths, _ in told][1:3] == [1, 2]
    assert [lost for _, _, lost in told] == [False, False, True, False, False]
    assert "Traceback" not in ran.stderr


class _Future:
    """A future whose worker dies twice after the task ended, before the value was fetched."""

    def __init__(self, killed: Exception) -> None:
        self.seen = iter(["finished", "lost", "finished", "finished"])
        self.fetched = iter([TimeoutError(), killed, 7])

    status = property(lambda self: next(self.seen))

    def result(self, timeout: float) -> int:
        value = next(self.fetched)
        if isinstance(value, Exception):
            raise value
        return value

    def release(self) -> None:
        pass


def test_a_worker_that_died_while_it_started_is_replaced():
    running, failed = (
        SimpleNamespace(status=SimpleNamespace(name=n)) for n in ("running", "failed")
    )
    asked = []
    loop = SimpleNamespace(add_callback=lambda act: act())
    cluster = SimpleNamespace(workers={0: running, 1: failed}, scale=asked.append, loop=loop)
    client = SimpleNamespace(cluster=cluster, nthreads=lambda: {"running": 1})
    assert _Seats(client, Workers(count=2)).count() == 1
    assert (cluster.workers, asked) == ({0: running}, [2])


def test_a_value_that_is_lost_with_its_worker_is_waited_for_while_workers_are_mended():
    from distributed import KilledWorker

    future, asked = _Future(KilledWorker("", None, 0)), []
    waits = iter([TimeoutError])

    def wait(held: list[_Future], **_words: object) -> SimpleNamespace:
        for error in waits:
            raise error
        return SimpleNamespace(done=held)

    client = SimpleNamespace(
        status="running",
        submit=lambda *_args, **_words: future,
        nthreads=lambda: asked.append(1) or {"worker": 1},
    )
    library = SimpleNamespace(KilledWorker=KilledWorker, wait=wait)
    there = Workers(scheduler="tcp://there:8786")
    outcomes = list(_run(library, client, len, iter(["task"]), there))
    assert outcomes == [Outcome("task", 7)]
    assert asked


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with a name")
def test_ctrl_c_keeps_what_is_done_and_resume_gives_the_same_table(traces, tmp_path, resumed):
    # nobody writes to it: the batch is not done when the signal arrives
    last = traces / "waiting.csv"
    os.mkfifo(last)
    out = tmp_path / "out"
    words = ["run-ripple", traces, "--no-report", "--out"]
    line = [*HDBENCH, "batch", *map(str, words), str(out), "--workers", "1"]
    running = subprocess.Popen(line, stderr=subprocess.PIPE, text=True, start_new_session=True)
    journal = out / "batch.jsonl"
    while running.poll() is None:
        if journal.exists() and journal.read_text().count('"row"') >= 1:
            os.killpg(running.pid, signal.SIGINT)
            break
        time.sleep(0.05)
    _, error = running.communicate()
    assert running.returncode == 130, error
    assert "--resume" in error
    assert "Traceback" not in error
    assert not (out / ".parts").exists()
    assert 1 <= len(table(out)) < 5
    last.unlink()
    record(last, 3)
    resumed(*words, out)
    resumed(*words, tmp_path / "whole")
    plain = [
        [{**row, "result": Path(row["result"]).name} for row in table(folder)]
        for folder in (out, tmp_path / "whole")
    ]
    assert plain[0] == plain[1]


@pytest.mark.parametrize(
    ("command", "options", "results"),
    [
        ("filter", (), {"x.csv", "x.result.json"}),
        ("tune", ("--slow", "none"), {"x.json", "x.result.json"}),
        ("orders", ("--model", "report-6"), {"x.result.json"}),
        ("diagnose", (), {"x"}),
    ],
)
def test_every_command_leaves_its_own_files(command, options, results, tmp_path):
    for name in ("results", ".parts"):
        (tmp_path / "out" / name).mkdir(parents=True)
    source = record(tmp_path / "x.csv", 0, seconds=3)
    task = {
        "command": command, "options": options, "input": "x.csv", "path": str(source),
        "name": "x", "out": str(tmp_path / "out"), "shown": "out", "known": None, "drive": "HD-1",
    }  # fmt: skip
    row = run_one(task)["row"]
    assert row["exit_code"] in (0, 6), row["error"]
    assert {file.name for file in (tmp_path / "out" / "results").iterdir()} == results
    assert (tmp_path / row["result"]).exists()
    assert row["drive"] == "HD-1"
    known = run_one(task | {"known": row["sha256"]})
    assert known["row"] is None


def test_inputs_are_files_folders_patterns_and_lists(traces, tmp_path):
    four = sorted(traces.iterdir())
    assert [entry.path for entry in expand_inputs([str(traces)])] == four
    pattern = expand_inputs([str(traces / "drive-*.csv"), str(four[0])])
    assert [entry.path for entry in pattern] == four[:3]
    listed = tmp_path / "list.csv"
    listed.write_text("input,drive,profile\ntraces/drive-1.csv,HD-7,\ngone.csv,,bench\n")
    assert expand_inputs([str(listed)]) == [
        Input(traces / "drive-1.csv", drive="HD-7"),
        Input(tmp_path / "gone.csv", profile="bench"),
    ]
    with pytest.raises(UsageError, match="no file fits"):
        expand_inputs([str(tmp_path / "*.none")])


def test_a_batch_folder_has_one_writer_and_survives_a_torn_line(tmp_path):
    entry = Input(record(tmp_path / "a.csv", 0))
    done = {"stamps": stamps_of(entry.path), "row": {
        "input": "a.csv", "sha256": "0", "exit_code": 4, "error": "=1+1", "result": None,
    }}  # fmt: skip
    folder = BatchFolder(tmp_path / "out", "filter", resume=False)
    with pytest.raises(BusyError):
        BatchFolder(tmp_path / "out", "filter", resume=True)
    folder.add(entry, "asked", "a", done)
    folder.write_table([done["row"]])
    folder.close()
    assert table(tmp_path / "out")[0]["error"] == "'=1+1"  # no formula of a spreadsheet
    with (tmp_path / "out" / "batch.jsonl").open("a") as file:
        file.write('{"identity": "half a li')
    with pytest.raises(UsageError, match="batch of filter"):
        BatchFolder(tmp_path / "out", "tune", resume=True)
    folder = BatchFolder(tmp_path / "out", "filter", resume=True)
    assert folder.kept(entry, "asked") is not None
    assert folder.kept(entry, "another option") is None
    folder.add(entry, "asked", "a", done)
    folder.close()
    assert len((tmp_path / "out" / "batch.jsonl").read_text().splitlines()) == 4


def test_names_of_results_are_unique_and_stay(tmp_path):
    inputs = [Input(tmp_path / place) for place in ("a/x.csv", "b/x.csv", "x.csv.gz")]
    folder = BatchFolder(tmp_path / "out", "filter", resume=False)
    assert folder.names(inputs) == ["x", "x-2", "x-3"]
    assert folder.names(inputs[::-1]) == ["x-3", "x-2", "x"]
    folder.close()


def test_the_extra_is_named_where_its_library_is_missing(hdbench, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert "hdbench[batch]" in hdbench("batch", "filter", "x.csv", code=2)[1]
