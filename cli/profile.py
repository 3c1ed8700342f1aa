"""`hdbench profile`: list, show, check and make profiles."""

from __future__ import annotations

import json
from pathlib import Path

import click

from hdbench_cli.output import Output

__all__ = ["command"]


@click.group(name="profile", epilog="Example: hdbench profile new my-bench --out my-bench.toml")
def command() -> None:
    """List, show, check and make profiles.

    A profile describes one bench: drive, sensor, DAQ, limits, experiments, filter and model.
    """


@command.command("list", epilog="Example: hdbench profile list")
@click.pass_obj
def list_(output: Output) -> None:
    """List the built-in profiles."""
    from hdbench.profile import list_profiles, load_profile
    from hdbench.records import result_header

    profiles = [load_profile(name) for name in list_profiles()]
    rows = [{**p.describe(), "description": p.data.description} for p in profiles]
    lines = "\n".join(f"{row['name']}  {row['description']}" for row in rows)
    body = {**result_header("profiles", None), "profiles": rows}
    output.result(body, lambda _console: click.echo(lines))


@command.command("show", epilog="Example: hdbench profile show cim-tr-97-06")
@click.argument("name", metavar="NAME|PATH", default="cim-tr-97-06")
@click.pass_obj
def show(output: Output, name: str) -> None:
    """Show the text of a profile."""
    from hdbench.profile import load_profile
    from hdbench.records import result_header

    profile = load_profile(name)
    body = {
        **result_header("profile", profile),
        **profile.describe(),
        "path": profile.path,
        "text": profile.text,
        "data": profile.data.model_dump(mode="json"),
    }
    output.result(body, lambda _console: click.echo(profile.text, nl=False))


@command.command("check", epilog="Example: hdbench profile check my-bench.toml")
@click.argument("files", metavar="FILE...", nargs=-1, required=True)
@click.pass_obj
def check(output: Output, files: tuple[str, ...]) -> None:
    """Check profiles and name every problem at once; exit 4 if there is one."""
    from hdbench.profile import check_profiles
    from hdbench.records import result_header

    profiles = check_profiles(files)
    rows = [{**p.describe(), "path": p.path} for p in profiles]
    output.result(
        {**result_header("profiles", None), "profiles": rows},
        lambda _console: click.echo("\n".join(f"{r['path']}: valid" for r in rows)),
    )


@command.command("new", epilog="Example: hdbench profile new my-bench --out my-bench.toml")
@click.argument("name")
@click.option(
    "--out",
    metavar="FILE",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File to write; else the text goes to stdout.",
)
@click.pass_obj
def new(output: Output, name: str, out: Path | None) -> None:
    """Make a profile to start from, with meaning and unit of every key."""
    from hdbench.profile import new_profile
    from hdbench.records import result_header, write_new

    text = new_profile(name)
    if out is not None:
        write_new(out, text.encode())
    body = {"name": name, "path": None if out is None else str(out), "text": text}
    output.result(
        {**result_header("profile-new", None), **body},
        lambda _console: click.echo(text if out is None else f"{out}\n", nl=False),
    )


@command.command("schema", epilog="Example: hdbench profile schema")
@click.pass_obj
def schema(output: Output) -> None:
    """Print the JSON schema of profiles, for editors."""
    from hdbench.profile import profile_schema

    body = profile_schema()
    output.result(body, lambda _console: click.echo(json.dumps(body, indent=2)))
