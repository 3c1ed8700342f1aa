"""Console of a command: results on stdout, everything else and a progress bar on stderr."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import click

from hdbench.errors import HdbenchError

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from hdbench.profile import Profile

Body = Mapping[str, Any]
Shown: TypeAlias = "str | Iterable[RenderableType]"


def show_lines(console: Console, lines: Iterable[RenderableType]) -> None:
    """Print lines and tables; a line is wrapped only where its `Text` says so."""
    from rich.text import Text

    for line in lines:
        whole = isinstance(line, str) or (isinstance(line, Text) and line.no_wrap is not False)
        console.print(line, soft_wrap=whole)


def headed(body: Body, kind: str, profile: Profile | None) -> Body:
    """Return a result with its kind, the version and the profile before all else."""
    if not kind:
        return body
    from hdbench.records import result_header

    return {**result_header(kind, profile), **body}


@dataclass(slots=True)
class Output:
    """The two streams of one command.

    Parameters
    ----------
    json : bool
        Print exactly one JSON object on stdout.
    verbose : int
        How many times ``-v`` was given.
    """

    json: bool = False
    verbose: int = 0

    def result(
        self, body: Body, lines: Shown, *, kind: str = "", profile: Profile | None = None
    ) -> None:
        """Print a result: the object with ``--json``, else lines, or a text as it stands.

        With a kind the object begins with it, the version and the profile.
        """
        if not self.json:
            if isinstance(lines, str):
                click.echo(lines, nl=False)
            else:
                show_lines(self.console(), lines)
            return
        click.echo(json.dumps(headed(body, kind, profile), allow_nan=False))

    def note(self, message: str) -> None:
        """Print one line to stderr, with or without ``--json``."""
        click.echo(message, err=True)

    def end(self, error: HdbenchError | None) -> None:
        """End with the code of an error that follows a result, if there is one.

        With ``--json`` the one object is out already: the error is a note.
        """
        if error is None:
            return
        if not self.json:
            raise error
        self.note(str(error))
        raise click.exceptions.Exit(error.exit_code)

    def error(self, error: HdbenchError) -> None:
        """Print an error: one JSON object on stdout with ``--json``, else red on stderr."""
        if self.json:
            click.echo(json.dumps({"error": error.to_dict()}, allow_nan=False))
            return
        from rich.text import Text

        console = self.console(stderr=True)
        for problem in error.problems or (error,):
            # a run that was stopped on purpose has not failed
            word = ("stopped ", "yellow") if problem.kind == "stopped" else ("error ", "bold red")
            text = Text.assemble(word, f"{problem.where}: {problem.what}\n")
            text.append("  fix: ", style="dim")
            text.append(problem.fix)
            console.print(text, soft_wrap=True)
        if error.problems:
            count = len(error.problems)
            words = f"{count} problem{'' if count == 1 else 's'} in {error.where}"
            console.print(Text(words), soft_wrap=True)

    @staticmethod
    def console(*, stderr: bool = False) -> Console:
        """Return a console on stdout or stderr; with ``NO_COLOR`` it writes plain text."""
        from rich.console import Console

        plain = bool(os.environ.get("NO_COLOR"))
        console = Console(
            stderr=stderr,
            color_system=None if plain else "auto",
            markup=False,
            emoji=False,
            highlight=False,
        )
        if not console.is_terminal:
            console.width = 100  # a file or pipe has no width of its own
        return console


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[[str, float], None]]:
    """Show a bar on stderr where that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda _what, _share: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.text import Text

    columns = (
        TextColumn("{task.fields[title]}"),
        BarColumn(bar_width=24),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.description}", markup=False),
    )
    console = Output.console(stderr=True)
    bar = Progress(*columns, console=console, transient=True)
    task = bar.add_task("", total=1.0, title=title)

    def show(what: str, share: float) -> None:
        # bar, share, elapsed time and gaps take 41 columns
        room = max(10, console.width - 41 - len(title))
        with suppress(OSError):
            bar.update(task, completed=share, description=Text(what).plain[:room])

    # a terminal that is closed meanwhile takes nothing with it: not the run, and not its exit code
    with suppress(OSError):
        bar.start()
    try:
        yield show
    finally:
        with suppress(OSError):
            bar.stop()
