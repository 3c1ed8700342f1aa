"""Where a command's words go: results on stdout, everything else on stderr."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from hdbench import __version__
from hdbench.errors import HdbenchError

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["Output"]


@dataclass(slots=True)
class Output:
    """One command's two streams.

    Parameters
    ----------
    json : bool
        Print exactly one JSON object on stdout.
    verbose : int
        How many times ``-v`` was given.
    """

    json: bool = False
    verbose: int = 0

    def result(self, obj: Mapping[str, Any], text: Callable[[Console], None]) -> None:
        """Print a result: the object with ``--json``, else what `text` draws."""
        if self.json:
            # a result names the version and the profile behind it, null where there is none
            named = {"hdbench_version": __version__, "profile": None} if "schema" in obj else {}
            missing = {key: value for key, value in named.items() if key not in obj}
            click.echo(json.dumps({**obj, **missing}, allow_nan=False))
            return
        text(self.console())

    def note(self, message: str) -> None:
        """Print one line to stderr, with or without ``--json``."""
        click.echo(message, err=True)

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
            console.print(Text(f"{len(error.problems)} problems in {error.where}"), soft_wrap=True)

    @staticmethod
    def console(*, stderr: bool = False) -> Console:
        """Return a console on stdout or stderr; with ``NO_COLOR`` it writes plain text."""
        import os

        from rich.console import Console

        plain = bool(os.environ.get("NO_COLOR"))
        console = Console(stderr=stderr, highlight=False, color_system=None if plain else "auto")
        if not console.is_terminal:
            console.width = 100  # a file or pipe has no width of its own
        return console
