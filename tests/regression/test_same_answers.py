"""The comparison of the answers of two versions: what it passes over, and what it finds."""

import json
from pathlib import Path
from typing import Any

import pytest
import same_answers

BEFORE: dict[str, Any] = {
    "hdbench_version": "0.1.0",
    "gain": 6.5,
    "run": "20261123T153512Z-calibration-40f45c",
    "scale": {"age_days": 0.01, "age_words": "0.0 days old, valid for 365"},
    "provenance": {"hdbench": "0.1.0", "device: firmware": "0.1.0", "device: serial": "sim-0"},
}


def recorded(folder: Path, answer: object, table: str = "a,b\n1.0,2.0\n") -> Path:
    """Write a recording of one command, under a name of the fixed set."""
    (folder / "cal-0").mkdir(parents=True)
    (folder / "cal-0" / "stdout.json").write_text(json.dumps(answer))
    (folder / "cal-0" / "exit-code.json").write_text("0\n")
    (folder / "cal-0" / "table.csv").write_text(table)
    return folder


def differences(tmp_path, after, table="a,b\n1.0,2.0\n", beyond=0.0):
    """Return whether another answer differs beyond a limit, or another table."""
    folders = recorded(tmp_path / "a", BEFORE), recorded(tmp_path / "b", after, table)
    return same_answers.compare(*folders, beyond=beyond)


def test_versions_ages_and_names_of_runs_may_differ(tmp_path):
    after = {
        "hdbench_version": "0.2.0",
        "gain": 6.5,
        "run": "20261124T000000Z-calibration-ffffff",
        "scale": {"age_days": 3.2, "age_words": "3.2 days old, valid for 365"},
        "provenance": {"hdbench": "0.2.0", "device: firmware": "0.2.0", "device: serial": "sim-0"},
    }
    assert differences(tmp_path, after) == 0


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"gain": 6.500000000000001}, ".gain: 6.5 -> 6.500000000000001"),
        ({"provenance": {"device: serial": "sim-1"}}, "only before"),
        ({"run": "20261123T153512Z-ripple-40f45c"}, ".run:"),
        ({"extra": None}, ".extra: only after"),
    ],
)
def test_any_other_difference_is_told(tmp_path, capsys, change, told):
    assert differences(tmp_path, BEFORE | change) == 1
    assert told in capsys.readouterr().out


def test_a_table_differs_in_its_last_digit(tmp_path):
    assert differences(tmp_path, BEFORE, "a,b\n1.0,2.1\n", beyond=1e-9) == 1


def test_what_has_a_reason_is_counted_apart(tmp_path, capsys, monkeypatch):
    fixed = tmp_path / "set.txt"
    fixed.write_text("~ cal-0/*: .gain: * = a better gain\n[calibrate]\ncal-0: calibrate\n")
    monkeypatch.setattr(same_answers, "SET", fixed)
    after = BEFORE | {"gain": 6.6}
    folders = recorded(tmp_path / "a", BEFORE), recorded(tmp_path / "b", after)
    assert same_answers.compare(*folders, beyond=0.0) == 0
    assert "on purpose, a better gain: 1\n" in capsys.readouterr().out
    folders = folders[0], recorded(tmp_path / "c", after | {"extra": 1})
    assert same_answers.compare(*folders, beyond=0.0) == 1


@pytest.mark.parametrize(
    ("after", "differs"),
    [({"gain": 6.5 + 1e-12}, 0), ({"gain": 6.5 + 1e-6}, 1), ({"gain": "none"}, 1)],
)
def test_a_reason_for_rounding_is_none_for_more(tmp_path, monkeypatch, after, differs):
    fixed = tmp_path / "set.txt"
    fixed.write_text("~ cal-0/*: .gain: * within 1e-9 = rounding\n[calibrate]\ncal-0: calibrate\n")
    monkeypatch.setattr(same_answers, "SET", fixed)
    assert differences(tmp_path, BEFORE | after) == differs
