"""Exit codes, JSON and colours of the command line; `--help` imports nothing heavy."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from rich.text import Text
from runkit import write_run

from hdbench.errors import HdbenchError
from hdbench_cli import main as main_module
from hdbench_cli.output import Output

README = Path(__file__).parents[2] / "README.md"


HEAVY = {"numpy", "scipy", "pymodbus", "matplotlib", "pydantic", "rich", "asyncio", "distributed"}
IMPORTED = """
import sys
from hdbench_cli.main import main
try:
    main(sys.argv[1:])
finally:
    print(*sys.modules, file=sys.stderr)
"""


@pytest.mark.parametrize("words", [["--help"], ["batch", "run-ripple", "--help"]])
def test_help_imports_nothing_heavy(words):
    command = [sys.executable, "-c", IMPORTED, *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert HEAVY & set(done.stderr.split()) == set()
    assert "run-ripple" in done.stdout


def test_json_may_stand_first_and_a_file_that_is_no_trace_is_one_object(hdbench):
    out, err = hdbench("--json", "filter", README, "--out", "x.csv", code=4)
    error = json.loads(out)["error"]
    assert (error["kind"], error["exit_code"]) == ("data", 4)
    assert error["fix"]
    assert "Traceback" not in err


def test_a_bug_gives_exit_1_and_a_traceback_only_with_v(monkeypatch, capsys):
    def broken(*_arguments: object, **_named: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr(main_module.cli, "main", broken)
    for output, shown in ((Output(), False), (Output(verbose=1), True)):
        assert main_module._run(["demo"], output) == 1
        err = capsys.readouterr().err
        assert "RuntimeError: boom" in err
        assert ("Traceback" in err) is shown


def test_version_with_v_names_the_kernel(hdbench):
    assert "kernel" in hdbench("--version", "-v")[0]
    assert hdbench("--version")[0].startswith("hdbench ")


def test_dry_run_prints_plan_duration_and_limits_and_moves_nothing(tmp_path, answer):
    body = answer("run-ripple", "--dry-run", "--out", tmp_path / "runs")
    assert body["plan"]["duration_s"] == 32.0
    assert body["limits"]["velocity_rad_s"] == 400.0
    assert not (tmp_path / "runs").exists()


def test_json_without_a_command_is_a_wrong_use_and_one_object(answer):
    assert answer(code=2)["error"]["kind"] == "usage"


@pytest.mark.parametrize(
    ("arguments", "kind"),
    [
        (["profile", "list"], "profiles"),
        (["profile", "show"], "profile"),
        (["profile", "check", "cim-tr-97-06"], "profiles"),
        (["profile", "new", "mine"], "profile-new"),
        (["runs", "list"], "runs"),
        (["run-ripple", "--dry-run"], "plan"),
    ],
)
def test_every_result_says_what_it_is_and_who_made_it(arguments, kind, answer):
    body = answer(*arguments)
    assert body["schema"] == f"hdbench/{kind}/1"
    assert body["hdbench_version"]
    assert body["profile"] is None or {"name", "sha256"} <= set(body["profile"])


def test_listing_a_folder_that_is_not_there_is_an_error(tmp_path, hdbench):
    assert "nowhere" in hdbench("runs", "list", tmp_path / "nowhere", code=4)[1]


def test_no_color_gives_plain_text_even_on_a_terminal(monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich then takes any stream for a terminal
    console = Output.console()
    with console.capture() as captured:
        console.print(Text.assemble(("error", "bold red"), " and ", ("fix", "dim")))
    assert captured.get() == "error and fix\n"


@pytest.mark.parametrize(
    ("scale", "code", "said"),
    [
        (1.0, 4, "torques their sign: cw positive, ccw negative"),
        (1.1, 6, "sign of the other direction (experiments 0.0-ccw, 0.5-ccw)"),
    ],
)
def test_torques_against_their_direction_are_doubtful_and_not_a_bug(
    tmp_path, scale, code, said, hdbench
):
    rows = ["experiment,position_rad,range,direction,series,torque_nm,reading_v"]
    for position in (0.0, 0.5):
        for direction, sign in (("cw", 1.0), ("ccw", -scale)):
            rows += [
                f"{position}-{direction},{position},full,{direction},up,{load},{sign * load / 6.6}"
                for load in (0.0, 10.0, 20.0, 30.0)
            ]
    file = tmp_path / "loads.csv"
    file.write_text("\n".join(rows) + "\n")
    words = ("calibrate", "--from", file, "--no-report", "--out", tmp_path / "runs")
    assert said in hdbench(*words, code=code)[1]
    hdbench(*words, "--check", code=code if code == 4 else 3)


@pytest.mark.parametrize(("count", "words"), [(1, "1 problem in a.toml"), (2, "2 problems in")])
def test_problems_are_counted_in_plain_english(count, words, capsys):
    problem = HdbenchError("found 1", where="a.toml:3", fix="give 2")
    Output().error(HdbenchError("bad", where="a.toml", fix="mend", problems=(problem,) * count))
    told = capsys.readouterr().err
    assert told.count("fix: give 2") == count
    assert words in told


@pytest.mark.parametrize("command", ["run-ripple", "run-misalignment"])
def test_even_a_dry_run_refuses_an_expired_calibration(command, tmp_path, hdbench):
    gain = {"gain_nm_per_v": {"value": 6.6, "std": 0.08, "dof": 3.0}}
    ended = "2001-01-01T00:00:00Z"
    old = write_run(tmp_path / "old", "calibration", gain, ended_utc=ended)
    words = (command, "--calibration", old, "--out", tmp_path / "runs", "--yes")
    for more in ((), ("--dry-run",)):
        assert "--allow-expired" in hdbench(*words, *more, code=4)[1]
    assert not (tmp_path / "runs").exists()
    assert "EXPIRED" in hdbench(*words, "--dry-run", "--allow-expired")[0]
