"""`hdbench completion`: the script that completes commands, options and names in a shell."""

from __future__ import annotations

import contextlib
import io

import click
from click.shell_completion import get_completion_class

from hdbench_cli.output import Output

# the shell hands over what is typed so far in this variable and those beside it
_VARIABLE = "_HDBENCH_COMPLETE"
_INSTALL = {
    "bash": "hdbench completion bash > ~/.local/share/bash-completion/completions/hdbench",
    "zsh": "hdbench completion zsh > ~/.zfunc/_hdbench   # ~/.zfunc in fpath, before compinit",
    "fish": "hdbench completion fish > ~/.config/fish/completions/hdbench.fish",
}


def completion_command(output: Output, shell: str) -> None:
    """Print the completion script of a shell."""
    from hdbench_cli.main import cli

    completion = get_completion_class(shell)
    if completion is None:
        raise click.ClickException(f"this version of click completes nothing in {shell}")
    # an old bash is told on stderr by click itself: the script stays what is asked for
    told = io.StringIO()
    with contextlib.redirect_stderr(told):
        script = completion(cli, {}, "hdbench", _VARIABLE).source()
    if told.getvalue().strip():
        output.note(told.getvalue().strip())
    output.result({"shell": shell, "script": script}, f"{script}\n", kind="completion")
    output.note(f"to install it: {_INSTALL[shell]}")
