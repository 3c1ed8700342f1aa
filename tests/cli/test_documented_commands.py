"""Every hdbench command line in README and docs names a command and options that exist."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest

from hdbench_cli import main as main_module

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"```(?:sh|bash|console)?\n(.*?)```", re.DOTALL)


def documented() -> list[tuple[str, str]]:
    lines = []
    for page in PAGES:
        for block in BLOCK.findall(page.read_text()):
            joined = block.replace("\\\n", " ")
            lines += [(page.name, x.strip()) for x in joined.splitlines()]
    return [(page, x.lstrip("$ ")) for page, x in lines if x.lstrip("$ ").startswith("hdbench ")]


LINES = documented()


def test_the_pages_show_commands() -> None:
    assert len(LINES) >= 10
    assert {"README.md"} <= {page for page, _ in LINES}


@pytest.mark.parametrize(("page", "line"), LINES, ids=[line[:60] for _, line in LINES])
def test_a_documented_command_line_exists(page: str, line: str) -> None:
    words = shlex.split(line, comments=True)[1:]
    group: click.Group | click.Command = main_module.cli
    context = click.Context(group)
    while isinstance(group, click.Group) and words and not words[0].startswith("-"):
        found = group.get_command(context, words[0])
        assert found is not None, f"{page}: no command {words[0]!r} in: {line}"
        group, words = found, words[1:]
    options = list(group.params)
    if group.name == "batch":
        # it hands the options of the other command on
        options += main_module.cli.get_command(context, words[0]).params
    known = {name for option in options for name in (*option.opts, *option.secondary_opts)}
    for word in words:
        if word.startswith("--"):
            assert word.split("=")[0] in known | {"--help"}, f"{page}: {word} in: {line}"
