"""A person calibrates on a terminal: keys, mistakes, quitting, kills, resuming."""

import json
import os
import re
from pathlib import Path
from subprocess import PIPE

import pytest
from forked import hdbench_process
from terminal import Person

from hdbench.records import resolve_input
from hdbench.records.recovery import verify_run
from hdbench.session.calibrating.conversation import LiveReading
from hdbench.session.calibrating.settling import Judgement
from hdbench_cli.asking.conversation import live_line


@pytest.fixture
def bench(tmp_path: Path, changed_profile) -> str:
    """Return a bench with one position, one side and three weights: six points."""
    one = {"positions": 1, "directions": ["cw"], "ranges": ["low"], "average_s": 0.5}
    text = changed_profile(calibration={**one, "low_masses_kg": [0.0, 0.5, 1.0]})
    path = tmp_path / "bench.toml"
    path.write_text(text)
    return str(path)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "runs"


def calibrate(bench: str, out: Path, **named) -> Person:
    return Person(["calibrate", "--profile", bench, "--out", out, "--no-report"], **named)


def resume(out: Path) -> Person:
    (path,) = out.iterdir()
    return Person(["runs", "resume", path, "--no-report"])


def set_up(bench: str, out: Path) -> Person:
    """Calibrate until the first weight is to be hung."""
    person = calibrate(bench, out)
    person.answer("Lock the wave generator", "\n")
    person.answer("position 1 of 1", "\n")
    person.answer(r"\[1 of 6\] bridge at rest", "\n")
    person.wait_for(r"\[3 of 6\].*Hang 0.5 kg.*\n  > ")
    return person


def loads(out: Path) -> list[str]:
    (path,) = out.glob("*/loads.csv")
    rows = [line.split(",") for line in path.read_text().splitlines()]
    return [row[rows[0].index("mass_kg")] for row in rows[1:]]


def check_kept(out: Path, readings: int) -> None:
    """Check that a run that has ended early holds these readings."""
    (path,) = out.iterdir()
    found = verify_run(path)
    assert (found.status, found.readings_in_journal) == ("incomplete", readings)


def test_wrong_weight_repeat_back_quit_resume_kill_resume_finish(bench, out):
    person = set_up(bench, out)
    person.press("1\n")
    person.answer(r"expected \+2.45 N m, read \+4.9\d N m: did you hang 1 kg\?", "\n")
    person.wait_for(r"\[4 of 6\].*Hang 1 kg.*\n  > ")
    second = resume(out)
    assert second.end() == 9
    assert "still goes on" in second.text
    person.press("r")
    person.wait_for("its reading is kept, marked repeat")
    person.answer(r"\[4 of 6\].*Hang 1 kg", "b")
    person.answer(r"\[3 of 6\].*Hang 0.5 kg", "\n")
    person.answer(r"\[4 of 6\].*Hang 1 kg", "q")
    assert person.end() == 130
    assert "hdbench runs resume" in person.text
    person = resume(out)
    person.wait_for("goes on after 2 readings")
    person.answer(r"\[4 of 6\].*Hang 1 kg", "\n")
    person.wait_for(r"\[5 of 6\].*\n  > ")
    person.process.kill()
    person.end()
    (path,) = out.iterdir()
    assert verify_run(path).recoverable
    resolve_input(path)  # loads.csv of the first session would lack the last reading
    assert loads(out) == ["0.0", "0.5", "1.0"]
    person = resume(out)
    person.answer(r"\[5 of 6\].*Hang 0.5 kg", "\n")
    person.answer(r"\[6 of 6\].*Take all weights off", "\n")
    person.answer("5 readings taken. Finish", "\n")
    assert person.end() == 0
    assert re.search(
        rf"next +hdbench (run-misalignment --calibration|diagnose) .*{path.name}", person.text
    )
    assert loads(out) == ["0.0", "0.5", "1.0", "0.5", "0.0"]
    report = verify_run(path)
    assert report.ok
    # five that count, one repeated, one gone back over; the rejected one is an event
    assert report.readings_in_journal == 7
    course = (path / "sequence.csv").read_text()
    assert [course.count(f",{word},") for word in ("repeat", "back", "rejected")] == [1, 1, 1]
    asked = json.loads((path / "run.json").read_text())
    assert [s["exit_reason"].split(":")[0] for s in asked["sessions"]] == [
        "saved",
        "killed; recovered from its journal",
    ]


def test_a_plain_terminal_gets_plain_lines_and_wrong_keys_harm_nothing(bench, out):
    person = calibrate(bench, out, term="dumb")
    person.answer("Lock the wave generator", "xb\x1b[A\t7")
    person.wait_for("no such answer here.*Enter: locked; q: save and quit")
    person.resize(10, 40)
    person.press("\n")
    person.answer("position", "\n")
    person.answer("bridge at", "1.2.3\n")
    person.wait_for("no such answer here")
    person.press("9\x7f\x7f\n")
    person.answer(r"\[3 of", "\x04")
    assert person.end() == 130
    assert "\x1b" not in person.raw


def test_ctrl_c_at_a_prompt_keeps_the_run_however_often(bench, out):
    person = set_up(bench, out)
    person.press(5 * "\x03")
    assert person.end() == 130
    assert "Traceback" not in person.text
    check_kept(out, 1)


def test_a_terminal_that_is_closed_keeps_the_run(bench, out):
    person = set_up(bench, out)
    os.close(person.master)
    assert person.process.wait(60) in (5, 129)
    check_kept(out, 1)


def test_the_end_of_piped_answers_keeps_the_run(bench, out):
    words = ["calibrate", "--profile", bench, "--out", out, "--no-report", "--operator", "person"]
    process = hdbench_process([*words, "--json"], stdin=PIPE, stdout=PIPE, text=True)
    told, _ = process.communicate("\n\n\n\n", timeout=60)
    assert process.returncode == 5
    assert "standard input has ended" in json.loads(told)["error"]["what"]
    check_kept(out, 2)


def test_the_live_line_fits_a_small_terminal():
    judged = Judgement(-9.8765, -1234.5, 9.8765, 0.5, None, None)
    line = live_line(LiveReading(judged, -65.432, 31.0))
    assert len("  " + line) <= 80
    assert "[#####.....]" in line
    assert "-9.8765 V -65.432 N m" in line


def test_a_mistake_that_nobody_knows_is_refused_before_anything_is_made(out, hdbench):
    words = ("calibrate", "--no-input", "--out", out, "--operator-mistakes", "fall@3")
    assert "is no mistake" in hdbench(*words, code=2)[1]
    assert not out.exists()
