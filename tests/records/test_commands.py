"""The commands over profiles, imports and runs: streams, exit codes, one JSON object."""

import json

import numpy as np
import pytest

from hdbench.profile import load_profile
from hdbench.records import RunFolder, read_trace
from hdbench.records.journal import JournalWriter


@pytest.fixture
def killed_run(tmp_path):
    profile = load_profile("cim-tr-97-06")
    folder = RunFolder.create(tmp_path / "runs", kind="ripple", profile=profile, details={})
    with JournalWriter(folder.journal) as journal:
        time_s = np.arange(20) * 1e-3
        journal.append("samples", {"time_s": time_s, "torque_v": time_s, "tacho_v": time_s})
    # above the largest process number of Linux
    folder.update(pid=2**22 + 1, process_mark=None)
    return folder.path


def test_a_bad_profile_exits_4_with_each_problem_on_its_line(tmp_path, hdbench, answer):
    path = tmp_path / "bad.toml"
    text = load_profile("cim-tr-97-06").text
    path.write_text(text.replace("gear_ratio", "gear_ration").replace("= 40.0 ", "= nan "))
    out, err = hdbench("profile", "check", path, code=4)
    assert out == ""
    assert err.count("bad.toml:") >= 3
    assert "did you mean 'drive.gear_ratio'" in err.replace("\n", " ")
    assert len(answer("profile", "check", path, code=4)["error"]["problems"]) == 3


def test_a_new_profile_is_written_once_and_checks(tmp_path, hdbench):
    path = tmp_path / "mine.toml"
    hdbench("profile", "new", "mine", "--out", path)
    hdbench("profile", "check", path)
    hdbench("profile", "new", "mine", "--out", path, code=2)
    assert hdbench("profile", "show", "cim-tr-97-06")[0] == load_profile("cim-tr-97-06").text
    assert json.loads(hdbench("profile", "schema")[0])["title"] == "ProfileData"


def test_an_import_ends_in_a_trace_and_a_bad_one_in_exit_4(tmp_path, hdbench, answer):
    source = tmp_path / "log.txt"
    source.write_text("zeit;moment\n0,000;1,5\n0,001;2,5\n")
    out = tmp_path / "t.csv"
    words = ("import", "--kind", "trace", source, "--time", "zeit", "--map", "torque_nm=moment*2")
    assert "read back" in hdbench(*words, "--out", out)[0]
    assert read_trace(out, require=("torque",))["torque_nm"].tolist() == [3.0, 5.0]
    source.write_text("zeit;moment\n0,000;1,5\n0,000;2,5\n")
    assert answer(*words, "--out", out, code=4)["error"]["where"] == f"{source}:3"


def test_a_killed_run_is_listed_verified_and_recovered(killed_run, hdbench, answer):
    assert f"{killed_run.name}  incomplete" in hdbench("runs", "list", killed_run.parent)[0]
    assert "20 samples" in hdbench("runs", "verify", killed_run)[0]
    assert answer("runs", "verify", "--recover", killed_run)["ok"] is True
    assert len(read_trace(killed_run / "trace.csv")) == 20
    (killed_run / "trace.csv").write_text("x")
    hdbench("runs", "verify", killed_run, code=4)
    assert answer("runs", "show", killed_run)["kind"] == "ripple"
