"""Groups and commands of click, made from commands.toml; a command is imported when it runs."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Iterable
from typing import Any

import click

from hdbench.errors import UsageError
from hdbench_cli.options import declared, parameter
from hdbench_cli.output import Output

# options of a command that a batch sets itself, that measure, or that name one file for all inputs
_NOT_IN_A_BATCH = {
    "address", "control", "drive", "dry_run", "html_file", "json", "junit", "list_causes",
    "map_file", "mistakes", "no_input", "out", "plan_file", "plant", "plot", "preset", "realtime",
    "source", "update", "verbose", "who", "yes",
}  # fmt: skip


class CommandGroup(click.Group):
    """The commands whose names begin with that of the group."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands in the order of the bench's work."""
        before = (self.name or "").split()
        names = map(str.split, declared("commands"))
        return [words[-1] for words in names if words[:-1] == before]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return one command."""
        known = cmd_name in self.list_commands(ctx)
        return made(f"{self.name or ''} {cmd_name}".strip()) if known else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without making them."""
        table, before = declared("commands"), f"{self.name or ''} ".lstrip()
        rows = [(name, table[before + name]["summary"]) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Name the nearest command when one is mistyped."""
        name, known = args[0], self.list_commands(ctx)
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"Did you mean '{near[0]}'?" if near else f"See '{ctx.command_path} --help'."
            ctx.fail(f"No such command '{name}'. {hint}")
        return super().resolve_command(ctx, args)


class BatchCommand(click.Command):
    """A command that also takes the options of the command that it runs."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Find the command among the words, and with it the options that may stand there."""
        names = declared("options")["batch"]["name"]["choices"]
        ctx.meta["batched"] = next((word for word in args if word in names), None)
        return super().parse_args(ctx, args)

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return the options of batch, and those of the command."""
        return [*super().get_params(ctx), *batch_options(ctx.meta.get("batched"))]


def batch_options(name: str | None) -> list[click.Option]:
    """Return the options of a command that a batch hands on."""
    options = made(name).params if name else []
    return [o for o in options if isinstance(o, click.Option) and o.name not in _NOT_IN_A_BATCH]


def made(name: str) -> click.Command:
    """Make a command, or a group of them, from what is declared under its name."""
    told = declared("commands")[name]
    example = " ".join(told["example"].split())
    told_of_all: dict[str, Any] = {
        "name": name,
        "help": told["help"],
        "epilog": f"Example{'s' if '; hdbench' in example else ''}: {example}",
    }
    if "module" not in told:
        return CommandGroup(**told_of_all, params=shared_options())

    @click.pass_obj
    def run(output: Output, /, **values: Any) -> Any:
        _refuse(told.get("refuses", ()), values)
        module = importlib.import_module(f"hdbench_cli.commands.{told['module']}")
        function = name.rpartition(" ")[2].replace("-", "_") + "_command"
        return getattr(module, function)(output, **values)

    params = [parameter(name, entry) for entry in told.get("takes", "").split()]
    kind = BatchCommand if name == "batch" else click.Command
    return kind(**told_of_all, callback=run, params=[*params, *shared_options()])


def _refuse(rules: Iterable[dict[str, Any]], values: dict[str, Any]) -> None:
    """Refuse options that contradict each other."""
    given = {
        name for name, value in values.items() if value not in (None, ()) and value is not False
    }
    for rule in rules:
        several = "several" not in rule or len(values[rule["several"]]) > 1
        if several and given >= {*rule.get("with", ())} and not given & {*rule.get("without", ())}:
            what = rule["what"].format_map(values)
            raise UsageError(what, where=rule["where"], fix=rule["fix"])


def shared_options() -> list[click.Parameter]:
    """Return the options of every command and group."""
    return [parameter("shared", name) for name in ("json", "verbose")]
