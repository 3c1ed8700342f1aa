"""Mistakes of a newcomer: the message says what, where and how to mend it; the exit code fits."""

import importlib
import inspect
import json
import os
import re
import resource
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import click
import numpy as np
import pytest
from forked import ended
from runkit import ran
from swinging_shaft import BENCH, record

from hdbench_cli.commandline import made
from hdbench_cli.next_step import after_import, after_run, after_tune
from hdbench_cli.options import declared
from hdbench_cli.output import Output

NAMES = ("time_s", "motor_velocity_rad_s", "torque_nm")


@pytest.fixture
def ask(hdbench: Callable[..., tuple[str, str]]) -> Callable[..., SimpleNamespace]:
    """Return a function that runs a command line with --json, for the error in its one object."""

    def call(*words: object, code: int) -> SimpleNamespace:
        shown, said = hdbench(*words, "--json", code=code)
        assert "Traceback" not in said
        told = {"kind": "", "what": said, "where": "", "fix": "", "problems": (), "exit_code": code}
        told |= json.loads(shown).get("error", {})
        assert told["exit_code"] == code
        return SimpleNamespace(**told)

    return call


def columns(n: int = 1500) -> dict[str, np.ndarray]:
    """Return the columns of a speed to and fro, its ripple and some noise."""
    told = {"motion": (0.0, 100.0, 4.0), "period_s": 2e-3, "noise_nm": 0.02, "seed": 7}
    trace = record(ripple=BENCH[:2], n=n, **told)
    return {name: trace[name] for name in NAMES}


def write(file: Path, data: dict[str, np.ndarray], *, sep: str = ",", mark: str = "") -> Path:
    rows = zip(*(map(repr, values.tolist()) for values in data.values()), strict=True)
    text = "\n".join([sep.join(data), *(sep.join(row) for row in rows)]) + "\n"
    comma = sep == ";"
    file.write_text(mark + (text.replace(".", ",") if comma else text), encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("words", "code", "fix"),
    [
        (("run-ripple", "--yes", "--address", "tcp://127.0.0.1:1"), 5, "doctor"),
        (("monitor", "--address", "/dev/ttyUSB0", "--duration", "1"), 2, "rtu:///dev/ttyUSB0"),
        (("monitor", "--address", "rtu:///dev/ttyNONE", "--duration", "1"), 5, "hdbench devices"),
    ],
)
def test_an_address_where_nothing_is(ask, words, code, fix):
    assert fix in ask(*words, code=code).fix


def without_rights() -> list[str]:
    """Return what runs a command without the right of root to open anything."""
    if os.geteuid() != 0:
        return []
    tool = shutil.which("setpriv")
    if tool is None:
        pytest.skip("root opens every file, and setpriv is not installed")
    lost = "-dac_override,-dac_read_search"
    return [tool, f"--bounding-set={lost}", f"--inh-caps={lost}"]


def test_no_right_to_write(tmp_path):
    trace = write(tmp_path / "trace.csv", columns(600))
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o555)
    words = ["filter", trace, "--model", "report-6", "--out", closed / "out.csv", "--json"]
    done = ended([*without_rights(), sys.executable, "-m", "hdbench_cli", *words])
    assert "Traceback" not in done.stderr
    error = json.loads(done.stdout)["error"]
    assert (done.returncode, error["kind"]) == (7, "storage")
    assert "Permission denied" in error["what"]
    assert str(closed) in error["where"]
    assert "write to" in error["fix"]


def test_a_disk_that_takes_no_more(ask, tmp_path):
    trace, out = write(tmp_path / "trace.csv", columns(600)), tmp_path / "out.csv"
    limit, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, most))
    try:
        told = ask("filter", trace, "--model", "report-6", "--out", out, code=7)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, most))
    assert told.kind == "storage"
    assert str(out) in told.where
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "code"),
    [(("run-ripple", "--no-report", "--from"), 4), (("filter", "--model", "report-6"), 6)],
)
def test_swapped_columns_are_doubted(ask, tmp_path, words, code):
    data = columns()
    velocity, torque = data["motor_velocity_rad_s"], data["torque_nm"]
    swapped = {**data, "motor_velocity_rad_s": torque, "torque_nm": velocity}
    file, out = write(tmp_path / "swapped.csv", swapped), tmp_path / "x.csv"
    told = ask(*words, file, "--out", out, code=code)
    assert "each other's place" in told.what
    assert "hdbench import --map" in told.what + told.fix


@pytest.mark.parametrize(
    ("column", "factor", "word"),
    [("motor_velocity_rad_s", 30.0 / np.pi, "rad/s"), ("torque_nm", 1000.0, "mN m")],
)
def test_a_wrong_unit_is_doubted(ask, tmp_path, column, factor, word):
    data = columns()
    file = write(tmp_path / "unit.csv", {**data, column: factor * data[column]})
    told = ask("run-ripple", "--from", file, "--no-report", "--out", tmp_path / "runs", code=6)
    assert word in told.what


@pytest.mark.parametrize(
    "words",
    [("run-ripple", "--no-report", "--from"), ("filter", "--model", "report-6"), ("diagnose",)],
)
def test_a_time_in_milliseconds_is_doubted_by_every_command(ask, tmp_path, words):
    data = columns()
    file = write(tmp_path / "ms.csv", {**data, "time_s": 1000.0 * data["time_s"]})
    told = ask(*words, file, "--out", tmp_path / "x.csv", code=6)
    # the result of a diagnosis says it, its last line names the flag
    assert "ms" in told.what or "wrong-channel" in told.what


def test_the_same_trace_in_its_own_units_is_not_doubted(hdbench, tmp_path):
    file = write(tmp_path / "right.csv", columns())
    hdbench("run-ripple", "--from", file, "--no-report", "--out", tmp_path / "runs")
    hdbench("filter", file, "--model", "report-6", "--out", tmp_path / "y.csv")


def test_a_calibration_that_is_not_there(ask, tmp_path):
    words = ("run-ripple", "--yes", "--calibration")
    assert "runs list" in ask(*words, tmp_path / "gone", code=4).fix
    (tmp_path / "empty").mkdir()
    assert "hdbench calibrate" in ask(*words, tmp_path / "empty", code=4).fix


def test_a_slip_in_a_key_is_told_with_its_line(ask, hdbench, tmp_path):
    file = tmp_path / "bench.toml"
    hdbench("profile", "new", "bench", "--out", file)
    text = file.read_text().replace("gear_ratio", "gear_ratoi", 1)
    file.write_text(text)
    line = 1 + text[: text.index("gear_ratoi")].count("\n")
    for words in (("profile", "check", file), ("run-ripple", "--dry-run", "--profile", file)):
        told = ask(*words, code=4)
        (slip,) = [p for p in told.problems if "gear_ratoi" in p["what"]]
        assert slip["where"] == f"{file}:{line}"
        assert "gear_ratio'" in slip["fix"]


@pytest.mark.parametrize(
    ("words", "code", "meant"),
    [
        (("run-riple",), 2, "run-ripple"),
        (("runs", "lst"), 2, "list"),
        (("run-ripple", "--dryrun"), 2, "--dry-run"),
        (("run-ripple", "--dry-run", "--profile", "cim-tr-97-6"), 4, "cim-tr-97-06"),
        (("run-ripple", "--yes", "--plant", "wron"), 4, "worn"),
        (("response", "--model", "report6", "--velocity", "50"), 4, "report-6"),
        (("plan", "--cause", "misalignmnt", "--no-loads"), 4, "misalignment"),
    ],
)
def test_the_name_that_was_meant_is_told(ask, words, code, meant):
    told = ask(*words, code=code)
    assert f"'{meant}'" in told.what + told.fix or f"`{meant}`" in told.fix


def test_decimal_commas_and_a_spreadsheets_mark_lead_to_the_import(ask, hdbench, tmp_path):
    data = columns(600)
    for name, mark in (("comma.csv", ""), ("sheet.csv", "\ufeff")):
        file = write(tmp_path / name, data, sep=";", mark=mark)
        words = ("filter", file, "--model", "report-6", "--out", tmp_path / "x.csv")
        told = ask(*words, code=4)
        assert told.where == f"{file}:1"
        assert "hdbench import" in told.fix
        out = tmp_path / f"clean-{name}"
        hdbench("import", "--kind", "trace", file, "--out", out)
        assert out.read_text().splitlines()[0] == ",".join(NAMES)


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return a run that was evaluated from a trace, and the last line of what was told."""
    folder = tmp_path_factory.mktemp("evaluated")
    file = write(folder / "trace.csv", columns())
    told = ran("run-ripple", "--from", file, "--no-report", "--out", folder / "my runs")
    (run,) = (folder / "my runs").iterdir()
    return run, told.rstrip().splitlines()[-1]


def test_a_run_that_was_moved_is_whole_and_one_that_lost_a_file_is_not(
    ask, hdbench, evaluated, tmp_path
):
    moved = shutil.copytree(evaluated[0], tmp_path / "elsewhere" / "renamed")
    hdbench("runs", "verify", moved)
    (moved / "run.json").unlink()
    told = ask("run-ripple", "--from", moved, "--no-report", "--out", tmp_path / "runs", code=4)
    assert "run.json" in told.what
    assert "runs list" in told.fix


def test_a_listed_run_can_be_named_as_it_is_listed_and_tells_the_next_command(
    evaluated, hdbench, monkeypatch
):
    run, last = evaluated
    assert last.startswith("next    hdbench diagnose ")
    monkeypatch.chdir(run.parents[1])
    listed = hdbench("runs", "list", "my runs")[0].split("  ")[0]
    shown, _ = hdbench("runs", "show", listed)
    assert "{" not in shown
    assert shown.rstrip().splitlines()[-1] == f"next    hdbench diagnose '{listed}'"


def test_an_empty_list_of_runs_says_where_it_looked(tmp_path, hdbench, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told, _ = hdbench("runs", "list")
    assert str(tmp_path / "runs") in told
    assert "hdbench demo" in told


def test_a_file_where_a_folder_has_to_be_is_told_as_such(ask, tmp_path):
    file = write(tmp_path / "trace.csv", columns(600))
    told = ask("report", file, "--out", file, code=7)
    assert "a file stands where a folder has to be" in told.fix


# a name without a module is a group
COMMANDS = {
    tuple(name.split()): made(name)
    for name, told in declared("commands").items()
    if "module" in told
}


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_an_unknown_option_is_one_json_object_with_a_fix(ask, path):
    told = ask(*path, "--no-such-option", code=2)
    assert told.kind == "usage"
    assert told.where == " ".join(("hdbench", *path))
    assert "--help" in told.fix


def words_for(path: tuple[str, ...], file: str) -> list[str]:
    """Return the words of a command that takes files; none where it takes none."""
    options, arguments = [], []
    for param in COMMANDS[path].params:
        if isinstance(param, click.Option) and param.required:
            kinds = getattr(param.type, "choices", None)
            options += [param.opts[0], kinds[0] if kinds else "out.csv"]
        elif isinstance(param, click.Argument):
            takes = any(word in (param.metavar or "") for word in ("RUN", "FILE"))
            arguments += [file] if takes else ["text"] if param.name == "text" else []
    return [*path, *options, *arguments] if file in arguments else []


# `runs verify` tells of every folder that it was given, in its result
MISSING = [words for path in COMMANDS if (words := words_for(path, "{}")) and path[-1] != "verify"]
MISSING += [
    ["regress", "{}"],
    ["plan", "--of", "{}"],
    ["simulate", "--like", "{}", "--out", "simulated.csv"],
    ["run-ripple", "--from", "{}"],
]


@pytest.mark.parametrize("words", MISSING, ids=" ".join)
def test_every_command_says_alike_that_nothing_is_there(ask, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    missing = str(tmp_path / "missing.csv")
    told = ask(*(word.format(missing) for word in words), code=4)
    assert told.where == missing
    # what is no run and no trace is told in its own words
    if words[0] in ("import", "profile"):
        assert told.fix
    else:
        assert told.what == "no such file or run"
        assert "hdbench runs list" in told.fix


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_every_command_has_help_that_ends_with_an_example_and_every_option_has_help(path):
    command = COMMANDS[path]
    assert command.help
    told = command.get_help(click.Context(command, info_name=" ".join(("hdbench", *path))))
    ends = re.split(r"\n\s*\n", told.rstrip())[-1].strip()
    assert re.match(r"Examples?: (`?)hdbench ", ends), ends
    options = [p for p in command.params if isinstance(p, click.Option)]
    assert [p.name for p in options if not p.help] == []
    assert any("--json" in p.opts for p in options)


def test_every_declared_option_is_taken_by_a_command():
    table = declared("options")
    taken = {" ".join(path): {p.name for p in command.params} for path, command in COMMANDS.items()}
    assert set(table) <= {"shared", *taken}
    assert set(table["shared"]) <= set().union(*taken.values())
    for name, entries in table.items():
        own = {entry.get("fills", key) for key, entry in entries.items()}
        assert name == "shared" or own <= taken[name], name


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_every_command_has_a_function_that_takes_what_is_declared(path):
    name = declared("commands")[" ".join(path)]["module"]
    module = importlib.import_module(f"hdbench_cli.commands.{name}")
    function = getattr(module, path[-1].replace("-", "_") + "_command")
    given = {p.name: None for p in COMMANDS[path].params if p.expose_value}
    inspect.signature(function).bind(Output(), **given)


def test_the_next_command_follows_the_work():
    folder = Path("runs/a b")
    assert after_run("calibration", folder, {"accepted": True}) == (
        "hdbench run-misalignment --calibration 'runs/a b'"
    )
    assert after_run("calibration", folder, {"accepted": False}).startswith("hdbench diagnose")
    named = {"profile_name": "mine.toml", "calibration": Path("runs/c")}
    assert after_run("misalignment", folder, {}, **named) == (
        "hdbench run-ripple --misalignment 'runs/a b' --calibration runs/c --profile mine.toml"
    )
    assert after_run("ripple", folder, {}) == "hdbench diagnose 'runs/a b'"
    assert after_import("loads", Path("l.csv"), (), None) == "hdbench calibrate --from l.csv"
    assert after_import("trace", Path("t.csv"), ("torque_v",), None) == ""
    made = "hdbench profile new drive --from t.csv --out drive.toml"
    assert after_import("trace", Path("t.csv"), ("tacho_v",), None) == made
    told = "hdbench diagnose t.csv --profile a.toml"
    assert after_import("trace", Path("t.csv"), ("tacho_v",), "a.toml") == told
    assert "--model t.json" in after_tune(Path("t.json"))


def test_traces_are_written_as_csv_only(ask, tmp_path):
    trace = tmp_path / "trace.csv"
    trace.write_text("time_s,motor_velocity_rad_s,torque_nm\n0,1,1\n0.001,1,1\n")
    assert "clean.csv" in ask("filter", trace, "--out", tmp_path / "clean.xlsx", code=2).fix
    assert not (tmp_path / "clean.xlsx").exists()


@pytest.mark.parametrize("typed", ["0", "50,0", "fast", "nan", "50;156"])
def test_response_needs_speeds_that_are_not_zero(ask, typed):
    told = ask("response", "--model", "report-6", "--velocity", typed, code=2)
    assert "rad/s" in told.what


def test_response_takes_several_speeds_in_one_word(answer):
    body = answer("response", "--model", "report-6", "--velocity", "50,156")
    assert [item["velocity_rad_s"] for item in body["responses"]] == [50.0, 156.0]
