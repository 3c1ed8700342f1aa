"""`hdbench runs list` and `runs note`: which runs there are, of which drive, with what noted."""

import csv
import io
import shutil
from pathlib import Path

import pytest
from runkit import ran, write_run

from hdbench.errors import DataError
from hdbench.profile import load_profile
from hdbench_cli.inputs import choose_profile
from hdbench_cli.options import StoredPath, newest_run

LOADS = Path(__file__).parents[1] / "stored" / "calibration" / "loads.csv"


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory):
    """Return two evaluations of one loads file, for two drives."""
    folder = tmp_path_factory.mktemp("evaluated")
    for drive in ("A-17", "=B(1)"):
        ran("calibrate", "--from", LOADS, "--drive", drive, "--out", folder, "--no-report")
    return folder


@pytest.fixture
def runs(evaluated, tmp_path):
    return shutil.copytree(evaluated, tmp_path, dirs_exist_ok=True)


@pytest.fixture
def drives(answer):
    """Return a function that lists runs, for their drives."""
    return lambda *words: [run["drive"] for run in answer("runs", "list", *words)["runs"]]


def test_runs_are_found_by_drive_and_sorted(runs, hdbench, drives):
    assert drives(runs, "--drive", "A-17") == ["A-17"]
    assert drives(runs, "--sort", "drive") == ["=B(1)", "A-17"]
    assert drives(runs, "--kind", "ripple") == []
    assert drives(runs, "--verdict", "accepted", "--since", "1d")
    assert drives(runs, "--since", "2999-01-01") == []
    assert "needed: a date" in hdbench("runs", "list", runs, "--since", "soon", code=2)[1]


def test_no_cell_of_the_csv_is_a_formula(runs, hdbench, tmp_path):
    rows = list(csv.DictReader(io.StringIO(hdbench("runs", "list", runs, "--csv")[0])))
    assert sorted(row["drive"] for row in rows) == ["'=B(1)", "A-17"]
    hdbench("runs", "list", runs, "--csv", tmp_path / "list.csv", "--json")
    assert (tmp_path / "list.csv").read_text().count("\n") == 3


def test_a_run_evaluated_again_keeps_its_drive_unless_another_is_named(
    runs, hdbench, answer, drives
):
    (run,) = answer("runs", "list", runs, "--drive", "A-17")["runs"]
    hdbench("calibrate", "--from", run["path"], "--out", runs / "again", "--no-report")
    assert drives(runs / "again") == ["A-17"]
    hdbench("calibrate", "--from", run["path"], "--drive", "C", "--out", runs / "x", "--no-report")
    assert drives(runs / "x") == ["C"]


def test_a_drive_that_nobody_named_is_the_profiles(tmp_path):
    text = load_profile("cim-tr-97-06").text
    file = tmp_path / "bench.toml"
    file.write_text(text + '\n[identity]\ndrive_serial = "RHS-20 17"\nflexspline_serial = "F3"\n')
    profile = choose_profile(str(file), None)
    assert (profile.drive, profile.sensor) == ("RHS-20 17", "F3")
    assert choose_profile(str(file), None, "C").drive == "C"


def test_notes_are_kept_and_shown(runs, hdbench, answer):
    (run,) = answer("runs", "list", runs, "--drive", "A-17")["runs"]
    hdbench("runs", "note", run["path"], "re-clamped")
    assert "new gauges" in hdbench("runs", "note", run["path"], "new gauges")[0]
    shown = answer("runs", "show", run["path"])
    assert [note["text"] for note in shown["notes"]] == ["re-clamped", "new gauges"]
    hdbench("runs", "note", run["path"], "a\nb", code=2)
    hdbench("runs", "note", runs, "no run", code=4)


def stored_run(folder: Path, kind: str, second: int) -> Path:
    run = folder / "runs" / f"20261121T1015{second:02d}Z-{kind}-3f9a1c"
    write_run(run, kind, started_utc=f"2026-11-21T10:15:{second:02d}Z")
    return run.relative_to(folder)


def test_last_names_the_newest_run_or_the_newest_of_a_kind(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError, match="no stored run in"):
        newest_run("last")
    calibration, ripple = (
        stored_run(tmp_path, *one) for one in (("calibration", 2), ("ripple", 5))
    )
    stored_run(tmp_path, "calibration", 1)
    assert newest_run("last") == ripple
    assert newest_run("last:calibration") == calibration
    assert newest_run("lasting") is newest_run("last:") is None
    with pytest.raises(DataError, match="no stored run of kind diagnosis"):
        newest_run("last:diagnosis")
    # a file of that name is the file
    (tmp_path / "last").write_text("")
    assert newest_run("last") is None


def test_a_run_stands_for_its_model_or_plan(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = stored_run(tmp_path, "diagnosis", 1)
    with pytest.raises(DataError, match="no such file"):
        StoredPath(inside="model.json").convert("last", None, None)
    (tmp_path / run / "model.json").write_text("{}")
    assert StoredPath(inside="model.json").convert("last", None, None) == run / "model.json"
    assert StoredPath().convert("last:diagnosis", None, None) == run
