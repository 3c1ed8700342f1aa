"""Every hdbench line in README, docs and help texts is right; the tutorial runs as it stands."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import click
import pytest

from hdbench_cli import main as main_module
from hdbench_cli.output import Output

sys.path.insert(0, str(Path(__file__).parent))
from conftest import Day

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
Serve = Callable[[str], str]


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
        assert command is not None
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


def executed() -> list[tuple[str, str]]:
    """Return the lines to execute: the tutorial, and one line of every other command."""
    seen: set[tuple[str, ...]] = set()
    out = []
    for where, line in sorted(LINES, key=lambda found: found[0] != "tutorial.md"):
        words = shlex.split(line, comments=True)[1:]
        name = tuple(words[: len(words) - len(command_of(words)[1])])
        if where == "tutorial.md" or name not in seen:
            out.append((where, line))
        seen.add(name)
    return out


def run_named(words: list[str], place: int, day: Day) -> str:
    """Return the run that a placeholder stands for."""
    before = words[place - 1]
    word = words[place]
    if before in ("--calibration", "--misalignment"):
        return day.runs[before.removeprefix("--")]
    if words[:2] == ["runs", "compare"]:
        first = not any(is_run(other) for other in words[:place])
        return day.runs["calibration" if first else "again"]
    if words[:2] == ["runs", "resume"]:
        return day.runs["stopped"]
    if words[0] == "calibrate":
        return day.runs["calibration"]
    if words[0] == "run-misalignment" or word.endswith("RUN2"):
        return day.runs["misalignment"]
    if before == "--for" or word.endswith("DIAGNOSIS"):
        return day.runs["diagnosis"]
    return day.runs["other" if word.endswith("OTHER") else "ripple"]


def is_run(word: str) -> bool:
    shown = r"runs/(\.\.\.|[A-Z0-9]+|\d{8}T\d{6}Z-[a-z]+-[0-9a-f]{6})"
    return re.fullmatch(shown, word) is not None or word == "RUN"


def concrete(line: str, day: Day, serve: Serve) -> list[str]:
    words = shlex.split(line, comments=True)[1:]
    words = words[: words.index(">")] if ">" in words else words
    found = [run_named(words, i, day) if is_run(word) else word for i, word in enumerate(words)]
    profile = found[found.index("--profile") + 1] if "--profile" in found else "cim-tr-97-06"
    return [serve(profile) if word.startswith("tcp://") else word for word in found]


@pytest.fixture(scope="session")
def serve() -> Iterator[Serve]:
    """Serve emulated benches for the lines that name an address, each profile's own."""
    served: dict[str, str] = {}
    with contextlib.ExitStack() as stack:

        def address_of(profile: str) -> str:
            if profile not in served:
                words = [sys.executable, "-m", "hdbench_cli", "emulate", "--profile", profile]
                node = stack.enter_context(
                    subprocess.Popen([*words, "--pace", "fast"], text=True, stdout=subprocess.PIPE)
                )
                stack.callback(node.terminate)
                assert node.stdout is not None
                found = re.search(r"tcp://[\d.]+:\d+", node.stdout.readline())
                assert found is not None
                served[profile] = found[0]
            return served[profile]

        yield address_of


def until_stopped(folder: Path, words: list[str]) -> int:
    """Run a command that goes on for ever, let it work, and interrupt it."""
    command = [sys.executable, "-m", "hdbench_cli", *words]
    with subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as process:
        assert process.stdout is not None
        # it works when it has said something
        assert process.stdout.read(1), process.wait(timeout=20.0)
        process.send_signal(signal.SIGINT)
        process.stdout.read()
        return process.wait(timeout=20.0)


def test_the_pages_show_commands() -> None:
    assert len(LINES) >= 40
    assert {"README.md", "help of hdbench diagnose"} <= {where for where, _ in LINES}


@pytest.mark.parametrize(("where", "line"), LINES, ids=[f"{w}: {x[:70]}" for w, x in LINES])
def test_a_documented_line_names_options_and_values_that_exist(where: str, line: str) -> None:
    words = shlex.split(line, comments=True)[1:]
    command, words = command_of(words[: words.index(">")] if ">" in words else words)
    context = click.Context(command)
    if command.name == "batch":  # it hands the options of the other command on
        context.meta["hdbench batch: command"] = words[0]
    values, _, order = command.make_parser(context).parse_args(list(words))
    for param in order:
        if not isinstance(param.type, click.Path) and param.name in values:
            param.type_cast_value(context, values[param.name])
    missing = [p.name for p in command.get_params(context) if p.required and not values.get(p.name)]
    assert missing == [], f"{where}: {line}"


def test_every_command_ends_its_help_with_an_example() -> None:
    shown = {where.removeprefix("help of ") for where, _ in LINES if where.startswith("help of ")}
    lines = {where for where, _ in help_lines(main_module.cli)}
    assert shown <= lines

    def leaves(group: click.Group, path: str) -> Iterator[str]:
        context = click.Context(group)
        for name in group.list_commands(context):
            command = group.get_command(context, name)
            if isinstance(command, click.Group):
                yield from leaves(command, f"{path} {name}")
            else:
                yield f"{path} {name}"

    assert set(leaves(main_module.cli, "hdbench")) == lines


@pytest.mark.parametrize(
    ("where", "line"), executed(), ids=[f"{w}: {x[:70]}" for w, x in executed()]
)
def test_the_tutorial_and_a_line_of_every_command_run(
    where: str,
    line: str,
    day: Day,
    serve: Serve,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path / "day"
    # links: a command that replaces a file leaves the day's own untouched
    shutil.copytree(day.folder, folder, copy_function=lambda a, b: Path(b).hardlink_to(a))
    words = concrete(line, day, serve)
    made = folder / words[words.index("--out") + 1] if "--out" in words else None
    if made is not None and made.is_file():
        made.unlink()  # the day has already what the line is there to make
    expected = EXIT.search(line)
    if words[0] in ENDLESS and "--duration" not in words:
        assert until_stopped(folder, words) == ENDLESS[words[0]]
        return
    if words[0] == "batch":  # starts processes of its own
        command = [sys.executable, "-m", "hdbench_cli", *words]
        assert subprocess.run(command, cwd=folder, check=False).returncode == 0
        return
    # in this process: starting a new one costs more than most commands
    monkeypatch.chdir(folder)
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr("sys.stdin", io.StringIO())
    code = main_module._run(words, Output(json="--json" in words))
    told = capsys.readouterr()
    # a check that was asked for may fail: the day is what it is
    allowed = {int(expected[1])} if expected else {0, 3} if "--check" in words else {0}
    assert code in allowed, f"{where}: {line}\n{told.out}{told.err}"
    assert "Traceback" not in told.err
