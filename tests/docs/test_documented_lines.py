"""Every hdbench line in README, docs and help texts is right; the tutorial runs as it stands."""

import io
import re
import shlex
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from forked import hdbench_process

from hdbench_cli import inputs
from hdbench_cli import main as main_module
from hdbench_cli.output import Output

ROOT = Path(__file__).parents[2]
# `make real` runs the lines of the logs of others, which are not in the project
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES.remove(ROOT / "docs" / "public-logs.md")
JOBS = sorted((ROOT / "examples" / "ci").glob("*.yml"))
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.DOTALL | re.MULTILINE)
INDENTED = re.compile(r"^(?:    |\$ )(hdbench .*)$", re.MULTILINE)
JOB_LINE = re.compile(r"^ *(?:- )?(?:run: )?(hdbench .*)$", re.MULTILINE)
# a line may end in `# exit 3`: what it is there to show
EXIT = re.compile(r"# exit (\d+)")
# they go on until they are told to stop
# and end so: to be interrupted is how a server ends, and not how a measurement does
ENDLESS = {"emulate": 0, "monitor": 130}
# commands that tests of their own run as they are documented: tests/batch, tests/cli
ELSEWHERE = {("batch",), ("runs", "resume")}
# all experiments and a diagnosis: it has a test for itself
DEMO = "hdbench demo"


def page_lines(page: Path) -> Iterator[str]:
    text = page.read_text()
    for language, block in FENCE.findall(text):
        if language in ("", "sh", "bash", "console"):
            joined = block.replace("\\\n", " ")
            yield from (line.strip().removeprefix("$ ") for line in joined.splitlines())
    yield from INDENTED.findall(FENCE.sub("", text).replace("\\\n", " "))


def help_lines(group: click.Group, path: str = "hdbench") -> Iterator[tuple[str, str]]:
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from help_lines(command, f"{path} {name}")
            continue
        told = f"{command.epilog or ''}\n\n{command.help or ''}"
        for found in re.findall(r"Examples?: (.*?)(?:\n\n|\Z)", told, re.DOTALL):
            for line in re.split(r";\s*(?=hdbench )", found):
                yield f"{path} {name}", " ".join(line.split()).strip("`. ")


def documented() -> list[tuple[str, str]]:
    found = [(page.name, line) for page in PAGES for line in page_lines(page)]
    found += [(job.name, line) for job in JOBS for line in JOB_LINE.findall(job.read_text())]
    found = [(page, line) for page, line in found if line.startswith("hdbench ")]
    found += [(f"help of {where}", line) for where, line in help_lines(main_module.cli)]
    return list({line: (where, line) for where, line in found}.values())


LINES = documented()


def command_of(words: list[str]) -> tuple[click.Command, list[str]]:
    """Return the command that a line names, and the words after its name."""
    command: click.Command = main_module.cli
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        found = command.get_command(click.Context(command), words[0])
        assert found is not None, f"no command {words[0]!r}"
        command, words = found, words[1:]
    return command, words


def executed() -> list[str]:
    """Return the lines to execute: those of the tutorial, then one of every other command."""
    seen, out = set(ELSEWHERE), []
    for where, line in sorted(LINES, key=lambda found: found[0] != "tutorial.md"):
        words = shlex.split(line, comments=True)[1:]
        name = tuple(words[: len(words) - len(command_of(words)[1])])
        if where == "tutorial.md" or name not in seen:
            out.append(line)
        seen.add(name)
    return out


def is_run(word: str) -> bool:
    shown = r"runs/(\.\.\.|[A-Z0-9]+|\d{8}T\d{6}Z-[a-z]+-[0-9a-f]{6})"
    return re.fullmatch(shown, word) is not None or word == "RUN"


def concrete(line: str, served: str) -> list[str]:
    """Return the words of a line, its placeholders replaced."""
    words = shlex.split(line, comments=True)[1:]
    words = words[: words.index(">")] if ">" in words else words
    # two runs of one kind: a calibration, and the same evaluated again
    ids = iter(sorted(str(path) for path in Path("runs").glob("*-calibration-*")))
    words = [next(ids) if is_run(word) else word for word in words]
    return [served if word.startswith("tcp://") else word for word in words]


@pytest.fixture
def served() -> Iterator[str]:
    """Serve an emulated bench for the lines that name an address."""
    words = ["emulate", "--pace", "fast"]
    with hdbench_process(words, text=True, stdout=subprocess.PIPE) as node:
        found = re.search(r"tcp://[\d.]+:\d+", node.stdout.readline())
        yield found[0]
        node.terminate()


def until_stopped(words: list[str]) -> int:
    """Run a command that goes on for ever, let it work, and interrupt it."""
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with hdbench_process(words, **streams) as process:
        # it works when it has said something
        assert process.stdout.read(1), process.wait(timeout=60.0)
        process.send_signal(signal.SIGINT)
        process.stdout.read()
        return process.wait(timeout=60.0)


def write_log(trace: Path, target: Path) -> None:
    """Write a trace as another program might have: with names of its own."""
    head, *rows = trace.read_text().splitlines()
    names = head.split(",")
    picked = [names.index(n) for n in ("time_s", "motor_velocity_rad_s", "torque_nm")]
    cells = [",".join(row.split(",")[i] for i in picked) for row in rows[:8000]]
    target.write_text("\n".join(["Timestamp,speed,torque", *cells]) + "\n")


def test_the_pages_show_commands():
    assert len(LINES) >= 40
    assert {"README.md", "help of hdbench diagnose"} <= {where for where, _ in LINES}


@pytest.mark.parametrize(("where", "line"), LINES, ids=[f"{w}: {x[:70]}" for w, x in LINES])
def test_a_documented_line_names_options_and_values_that_exist(where, line):
    words = shlex.split(line, comments=True)[1:]
    command, words = command_of(words[: words.index(">")] if ">" in words else words)
    context = click.Context(command)
    if command.name == "batch":  # it hands the options of the other command on
        context.meta["batched"] = words[0]
    values, _, order = command.make_parser(context).parse_args(list(words))
    for param in order:
        if not isinstance(param.type, click.Path) and param.name in values:
            param.type_cast_value(context, values[param.name])
    missing = [p.name for p in command.get_params(context) if p.required and not values.get(p.name)]
    assert missing == [], f"{where}: {line}"


def answered(line: str, words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a line in this process, which costs less than most commands; return what is wrong."""
    if words[0] in ENDLESS and "--duration" not in words:
        code, told = until_stopped(words), ""
        allowed = {ENDLESS[words[0]]}
    else:
        code = main_module._run(words, Output(json="--json" in words))
        told = capsys.readouterr().err
        expected = EXIT.search(line)
        # a check that was asked for may fail: the record is what it is
        allowed = {int(expected[1])} if expected else {0, 3} if "--check" in words else {0}
    return "" if code in allowed and "Traceback" not in told else f"{line}: exit {code}\n{told}"


@pytest.fixture
def short_runs(tmp_path, monkeypatch, changed_profile) -> None:
    """Work in an empty folder, on a bench whose runs take seconds, calibrated with few weights."""
    monkeypatch.chdir(tmp_path)
    weights = {"ranges": ["full"], "full_masses_kg": [0.0, 4.0, 8.0]}
    # `make demo` has them at full length
    short = changed_profile(
        calibration={"positions": 2, "average_s": 0.25, **weights},
        misalignment={"velocity_rad_s": 300.0},
        ripple={"duration_s": 3.0},
    )
    Path("short.toml").write_text(short)
    monkeypatch.setattr(inputs, "DEFAULT_PROFILE", "short.toml")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr("sys.stdin", io.StringIO())


def test_the_demo_runs(short_runs, capsys):
    (line,) = [line for line in executed() if line.startswith(DEMO)]
    assert answered(line, shlex.split(line, comments=True)[1:], capsys) == ""


def test_the_tutorial_and_a_line_of_every_other_command_run(short_runs, served, capsys):
    shutil.copytree(ROOT / "tests" / "stored", "tests/stored")
    wrong = []
    for line in executed():
        if line.startswith(DEMO):
            continue
        if "runs/RUN1" in line:
            again = ["calibrate", "--from", "last:calibration", "--no-report"]
            wrong.append(answered("twice", again, capsys))
        if "log.csv" in line and not Path("log.csv").exists():
            write_log(next(Path("runs").glob("*-ripple-*/trace.csv")), Path("log.csv"))
        wrong.append(answered(line, concrete(line, served), capsys))
    assert "\n".join(filter(None, wrong)) == ""
