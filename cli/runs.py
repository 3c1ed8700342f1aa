"""`hdbench runs`: list, show and verify run folders."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.records import RunSummary, VerifyReport

__all__ = ["command"]


@click.group(name="runs")
def command() -> None:
    """List, show and verify run folders.

    Example: hdbench runs verify runs/*
    """


def _list_lines(parent: Path, runs: tuple[RunSummary, ...]) -> str:
    lines = [f"{r.path.name}  {r.status:10}  {r.profile}  {r.exit_reason}".rstrip() for r in runs]
    return "\n".join(lines) or f"no runs in {parent}"


@command.command("list")
@click.argument(
    "parent", metavar="[DIR]", default="runs", type=click.Path(path_type=Path, file_okay=False)
)
@click.pass_context
def list_(ctx: click.Context, parent: Path) -> None:
    """List the runs in a folder, oldest first.

    Example: hdbench runs list runs
    """
    from hdbench.errors import DataError
    from hdbench.records import list_runs, result_header

    output: Output = ctx.obj
    if not parent.is_dir() and ctx.get_parameter_source("parent") is not ParameterSource.DEFAULT:
        raise DataError(
            "no such folder", where=str(parent), fix="name the folder that --out of the runs named"
        )
    runs = list_runs(parent)
    output.result(
        {**result_header("runs", None), "runs": [run.to_dict() for run in runs]},
        lambda _console: click.echo(_list_lines(parent, runs)),
    )


def _draw_run(console: Console, body: dict[str, Any]) -> None:
    from rich.text import Text

    for key, value in body.items():
        if key != "profile":
            console.print(Text(f"{key:13} {value}"), soft_wrap=True)
    console.print(Text(f"profile       {body['profile'].get('name')}"))


@command.command("show")
@click.argument("run", metavar="RUN", type=click.Path(path_type=Path))
@click.pass_obj
def show(output: Output, run: Path) -> None:
    """Show what a run says of itself.

    Example: hdbench runs show runs/20261121T101500Z-ripple-3f9a1c
    """
    from hdbench.records import RunFolder

    folder = RunFolder.open(run)
    body = {**folder.manifest, "status": folder.status()}
    output.result(body, lambda console: _draw_run(console, body))


def _draw_checks(console: Console, reports: list[VerifyReport]) -> None:
    from rich.text import Text

    for report in reports:
        word, style = ("ok", "green") if report.ok else ("INVALID", "bold red")
        line = f" {report.run_id}: {report.status}, {report.files_checked} files checked, "
        line += f"{report.samples_in_journal} samples and {report.readings_in_journal} readings"
        console.print(Text.assemble((word, style), f"{line} acknowledged"), soft_wrap=True)
        for problem in report.problems:
            console.print(Text(f"  {problem}"), soft_wrap=True)
        if report.torn_bytes:
            console.print(f"  {report.torn_bytes} bytes at the end were never acknowledged")
        if report.recoverable:
            console.print("  its data can be recovered: hdbench runs verify --recover")


@command.command("verify")
@click.argument("runs", metavar="RUN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--recover", is_flag=True, help="Write trace or loads of a killed run.")
@click.pass_obj
def verify(output: Output, runs: tuple[Path, ...], recover: bool) -> int:
    """Read runs in full and compare them with their hashes; exit 4 if one is invalid.

    Example: hdbench runs verify runs/20261121T101500Z-ripple-3f9a1c --recover
    """
    from hdbench.records import result_header, verify_runs

    reports = verify_runs(runs, recover=recover)
    ok = all(report.ok for report in reports)
    output.result(
        {
            **result_header("verify", None),
            "ok": ok,
            "runs": [report.to_dict() for report in reports],
        },
        lambda console: _draw_checks(console, reports),
    )
    return 0 if ok else 4
