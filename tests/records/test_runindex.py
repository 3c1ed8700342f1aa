"""The index of runs: never more than a cache of what the folders say."""

import json
import sqlite3
import sys
import time
from datetime import UTC, datetime

import index_histories
import pytest
from runkit import write_run

from hdbench.records import list_runs, select_runs
from hdbench.records import runindex as index


def later():
    return time.time_ns() + 10**10


def add(parent, name, *, drive="A", verdict="named", started="2026-11-21T10:00:00Z", kind=None):
    result = {"verdict": verdict, "accepted": None}
    return write_run(parent / name, kind or "diagnosis", result, drive=drive, started_utc=started)


@pytest.mark.skipif(sys.platform == "win32", reason="forks")
@pytest.mark.parametrize(
    "seed", [*range(3), *(pytest.param(n, marks=pytest.mark.campaign) for n in range(3, 200))]
)
def test_a_random_history_never_parts_list_and_folders(seed):
    index_histories.run_history(seed)


def test_what_is_kept_is_not_read_again_and_what_changed_is(tmp_path, monkeypatch):
    add(tmp_path, "a")
    folder = add(tmp_path, "b")
    read = []
    original = index.read_run
    monkeypatch.setattr(index, "read_run", lambda path: read.append(path.name) or original(path))
    first = list_runs(tmp_path, clock_ns=later)
    assert list_runs(tmp_path, clock_ns=later) == first
    assert read == ["a", "b"]
    (folder / "result.json").write_text(json.dumps({"verdict": "unexplained"}))
    assert [run.verdict for run in list_runs(tmp_path, clock_ns=later)] == ["named", "unexplained"]
    assert read == ["a", "b", "b"]


def test_a_run_that_has_just_changed_is_not_trusted(tmp_path):
    # one tick of the file system's clock can hold two changes of the same size
    add(tmp_path, "a")
    list_runs(tmp_path)
    assert not (tmp_path / index.INDEX_NAME).exists()


@pytest.mark.parametrize("content", [b"", b"not a database", b"SQLite format 3\0" + b"\xff" * 4096])
def test_a_damaged_index_is_made_anew(tmp_path, content):
    add(tmp_path, "a")
    truth = list_runs(tmp_path, clock_ns=later)
    (tmp_path / index.INDEX_NAME).write_bytes(content)
    for _ in range(3):
        assert list_runs(tmp_path, clock_ns=later) == truth
    with sqlite3.connect(tmp_path / index.INDEX_NAME) as db:
        assert db.execute("SELECT count(*) FROM runs").fetchone() == (1,)


def test_an_index_that_another_process_holds_costs_time_not_truth(tmp_path, monkeypatch):
    monkeypatch.setattr(index, "_LOCK_S", 0.01)
    add(tmp_path, "a")
    list_runs(tmp_path, clock_ns=later)
    add(tmp_path, "b")
    with sqlite3.connect(tmp_path / index.INDEX_NAME) as holder:
        holder.execute("BEGIN EXCLUSIVE")
        assert [run.path.name for run in list_runs(tmp_path, clock_ns=later)] == ["a", "b"]
    assert (tmp_path / index.INDEX_NAME).exists()


def test_a_folder_where_no_index_can_be_written_is_listed(tmp_path):
    add(tmp_path, "a")
    (tmp_path / index.INDEX_NAME).mkdir()
    assert len(list_runs(tmp_path, clock_ns=later)) == 1


def test_runs_are_chosen_by_what_they_are(tmp_path):
    add(tmp_path, "a", drive="A", verdict="named")
    add(tmp_path, "b", drive="B", verdict="named", started="2026-11-22T10:00:00+02:00")
    add(tmp_path, "c", kind="calibration", started="soon")
    add(tmp_path, "d", kind="ripple")
    runs = list_runs(tmp_path)
    assert [run.verdict for run in runs] == ["named", "named", "not-decided", "ok"]

    def names(since=None, **wanted):
        return "".join(run.path.name for run in select_runs(runs, wanted, since))

    assert names(drive=("B",), verdict=()) == "b"
    assert names(drive=("A", "B"), kind=("diagnosis",)) == "ab"
    assert names(since=datetime(2026, 11, 22, 8, tzinfo=UTC)) == "b"
    assert names(since=datetime(2026, 11, 22, 8, 1, tzinfo=UTC)) == ""
