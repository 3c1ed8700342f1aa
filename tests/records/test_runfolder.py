"""A run folder says what was done and how it ended; a killed run gives its data back."""

import hashlib
import itertools
import json
import os
import re
import signal
import subprocess
from dataclasses import asdict
from datetime import UTC, datetime
from functools import partial

import numpy as np
import pytest
from forked import forked

from hdbench import records
from hdbench.errors import DataError, StorageError
from hdbench.records.journal import JournalWriter
from hdbench.records.recovery import recover_run, verify_run

MOMENT = datetime(2026, 11, 21, 10, 15, tzinfo=UTC)
# no process has this number: it is above the largest that Linux gives out
NOBODY = 2**22 + 1


def make(parent, profile, kind="ripple", token="3f9a1c"):
    fixed = {"clock": lambda: MOMENT, "token": lambda: token}
    return records.RunFolder.create(
        parent, kind=kind, profile=profile, details={"seed": 1}, **fixed
    )


def samples(folder, n_blocks=3):
    with JournalWriter(folder.journal) as journal:
        for k in range(n_blocks):
            time_s = (np.arange(10) + 10 * k) * 1e-3
            columns = {"time_s": time_s, "torque_v": time_s + 1, "tacho_v": time_s * 0 + 2}
            journal.append("samples", columns, {"first_index": 10 * k})


def killed(folder):
    folder.update(pid=NOBODY, process_mark=None)


@pytest.fixture
def folder(tmp_path, profile):
    return make(tmp_path, profile)


def test_a_new_run_is_named_by_time_and_kind_and_holds_what_the_contract_lists(tmp_path, profile):
    folder = make(tmp_path / "runs", profile)
    assert folder.run_id == "20261121T101500Z-ripple-3f9a1c"
    body = json.loads((folder.path / "run.json").read_text())
    needed = {"kind", "status", "started_utc", "ended_utc", "exit_reason", "profile", "files"}
    assert needed | {"calibration", "device", "versions", "schema", "hdbench_version"} <= set(body)
    assert body["profile"] == {
        "name": profile.name,
        "sha256": hashlib.sha256(body["profile"]["text"].encode()).hexdigest(),
        "text": profile.text,
    }
    assert (body["status"], body["kind"]) == ("running", "ripple")
    assert body["started_utc"] == "2026-11-21T10:15:00.000000Z"
    assert folder.status() == "running"
    by_default = records.RunFolder.create(tmp_path, kind="ripple", profile=profile, details={})
    assert re.fullmatch(r"\d{8}T\d{6}Z-ripple-[0-9a-f]{6}", by_default.run_id)


def test_a_run_is_not_made_where_another_one_or_a_file_is(tmp_path, profile):
    make(tmp_path, profile)
    (tmp_path / "file").write_text("")
    for parent in (tmp_path, tmp_path / "file" / "runs"):
        with pytest.raises(StorageError):
            make(parent, profile)


def test_a_finished_run_hashes_its_files_and_verify_sees_any_change(folder):
    samples(folder)
    folder.trace.write_text("time_s,torque_nm,tacho_v\n0,1,2\n")
    folder.result.write_text("{}")
    folder.finish("complete", "done")
    digest = hashlib.sha256(folder.trace.read_bytes()).hexdigest()
    assert folder.manifest["files"]["trace.csv"] == digest
    report = verify_run(folder.path)
    assert (report.ok, report.files_checked, report.samples_in_journal) == (True, 3, 30)
    folder.trace.write_text("time_s,torque_nm,tacho_v\n0,1,3\n")
    folder.result.unlink()
    assert [p.split()[0] for p in verify_run(folder.path).problems] == ["trace.csv", "result.json"]


def test_a_killed_run_is_incomplete_and_gives_back_every_acknowledged_sample(folder):
    samples(folder)
    with folder.journal.open("ab") as file:
        file.write(b"HDJ1 torn")
    killed(folder)
    report = verify_run(folder.path)
    assert (report.status, report.ok, report.recoverable) == ("incomplete", True, True)
    assert (report.samples_in_journal, report.torn_bytes) == (30, 9)
    trace = records.read_trace(records.resolve_input(folder.path))
    assert trace.time_s.tobytes() == (np.arange(30) * 1e-3).tobytes()
    again = records.RunFolder.open(folder.path)
    assert again.manifest["status"] == "incomplete"
    assert set(again.manifest["files"]) == {"journal.hdj", "trace.csv"}
    assert verify_run(folder.path).ok


def test_a_killed_calibration_gives_back_its_readings(tmp_path, profile):
    folder = make(tmp_path, profile, kind="calibration")
    reading = records.LoadReading("p0-cw-full", 0.0, "full", "cw", "up", 9.8, 1.48, mass_kg=2.0)
    with JournalWriter(folder.journal) as journal:
        journal.append("event", {}, {"lock_rad": 0.0})
        journal.append("reading", {}, {**asdict(reading), "settled": False})
    killed(folder)
    path = records.resolve_input(folder.path)
    assert path.name == "loads.csv"
    loads = records.read_loads(path, None)
    assert loads.readings == (reading,)
    assert loads.extra_columns == {"settled": ("false",)}


def test_a_run_that_goes_on_is_left_alone(folder):
    samples(folder)
    with pytest.raises(DataError, match="still goes on"):
        recover_run(folder)
    assert not folder.trace.exists()


def test_a_later_process_with_the_same_number_is_not_taken_for_the_run(folder):
    if folder.manifest["process_mark"] is None:
        pytest.skip("this system does not tell processes apart")
    folder.update(process_mark="another boot:1")
    assert folder.status() == "incomplete"


def test_a_run_of_another_host_counts_as_running_while_its_journal_grows(folder):
    samples(folder)
    folder.update(host="elsewhere")
    for age_s, status in ((5, "running"), (3600, "incomplete")):
        os.utime(folder.journal, 2 * (MOMENT.timestamp() - age_s,))
        assert folder.status() == status


def test_a_damaged_journal_is_a_problem_and_keeps_what_is_intact(folder):
    samples(folder)
    raw = bytearray(folder.journal.read_bytes())
    raw[len(raw) // 2] ^= 1
    folder.journal.write_bytes(raw)
    killed(folder)
    report = verify_run(folder.path)
    assert not report.ok
    assert report.samples_in_journal == 20
    assert len(records.read_trace(recover_run(folder))) == 20
    assert "damaged" in records.RunFolder.open(folder.path).manifest["exit_reason"]


RIPPLE = '{"schema": "hdbench/run/1", "kind": "ripple", "profile": {}, '


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        '{"schema": "hdbench/run/1"}',
        RIPPLE + '"status": "great", "files": {}}',
        RIPPLE + '"status": "complete", "files": []}',
    ],
)
def test_a_broken_run_is_listed_as_invalid_and_refused(tmp_path, text):
    path = tmp_path / "20260101T000000Z-ripple-000000"
    path.mkdir()
    (path / "run.json").write_text(text)
    with pytest.raises(DataError):
        records.RunFolder.open(path)
    assert [run.status for run in records.list_runs(tmp_path)] == ["invalid"]
    assert not records.verify_runs([path])[0].ok


def test_a_hostile_file_name_in_a_run_is_not_followed(folder):
    folder.update(status="complete", files={"../../etc/passwd": "0"})
    (problem,) = verify_run(folder.path).problems
    assert "not the name" in problem


def test_runs_are_listed_oldest_first(tmp_path, profile):
    for token in ("bbbbbb", "aaaaaa"):
        make(tmp_path, profile, token=token)
    assert [run.path.name[-6:] for run in records.list_runs(tmp_path)] == ["aaaaaa", "bbbbbb"]
    assert records.list_runs(tmp_path / "none") == ()


@pytest.mark.parametrize("kind", ["missing", "no run", "no data"])
def test_an_input_without_data_is_refused(tmp_path, profile, kind):
    path = tmp_path / "x"
    if kind == "no run":
        path.mkdir()
    if kind == "no data":
        path = make(tmp_path, profile, kind="diagnosis").path
    with pytest.raises(DataError):
        records.resolve_input(path)


def write_for_ever(parent, profile):
    folder = records.RunFolder.create(parent, kind="ripple", profile=profile, details={})
    journal = JournalWriter(folder.journal)
    for k in itertools.count():
        time_s = (np.arange(50) + 50 * k) * 1e-3
        journal.append("samples", {"time_s": time_s, "torque_v": time_s, "tacho_v": time_s})
        os.write(1, b"%d\n" % (50 * (k + 1)))


@pytest.mark.skipif(os.name != "posix", reason="kill -9")
def test_a_run_killed_for_real_keeps_what_was_acknowledged(tmp_path, profile):
    act = partial(write_for_ever, tmp_path, profile)
    with forked(act, stdout=subprocess.PIPE, text=True) as process:
        for _ in range(40):
            process.stdout.readline()
        (running,) = records.list_runs(tmp_path)
        process.send_signal(signal.SIGKILL)
        words = process.stdout.read().split("\n")[:-1]
    # 40 blocks of 50 samples were acknowledged before the signal, more while it was on its way
    acknowledged = int(words[-1]) if words else 2000
    assert running.status == "running"
    (report,) = records.verify_runs([running.path], recover=True)
    assert (report.ok, report.status) == (True, "incomplete")
    assert report.samples_in_journal in (acknowledged, acknowledged + 50)
    time_s = records.read_trace(records.resolve_input(running.path)).time_s
    assert time_s.tolist() == (np.arange(report.samples_in_journal) * 1e-3).tolist()
