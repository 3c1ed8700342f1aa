"""`hdbench runs`: list, show, note on, verify, resume and compare run folders."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.commands.calibrate import mistakes_option
from hdbench_cli.commands.runs_compare import compare
from hdbench_cli.commands.runs_list import list_, note
from hdbench_cli.options import address_option, control_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.records import VerifyReport

__all__ = ["command"]


@click.group(name="runs", epilog="Example: hdbench runs verify runs/*")
def command() -> None:
    """List, show, note on, verify, resume and compare run folders."""


@command.command("show", epilog="Example: hdbench runs show runs/20261121T101500Z-ripple-3f9a1c")
@click.argument("run", metavar="RUN", type=click.Path(path_type=Path))
@click.pass_obj
def show(output: Output, run: Path) -> None:
    """Show what a run says of itself."""
    from dataclasses import asdict

    from hdbench.records import RunFolder, read_notes
    from hdbench_cli.commands.runs_show import draw_run

    folder = RunFolder.open(run)
    notes = [asdict(note) for note in read_notes(run)]
    body = {**folder.manifest, "status": folder.status(), "notes": notes}
    output.result(body, lambda console: draw_run(console, body, run))


def _draw_checks(console: Console, runs: Sequence[Path], reports: Sequence[VerifyReport]) -> None:
    from rich.text import Text

    for run, report in zip(runs, reports, strict=True):
        word, style = ("ok", "green") if report.ok else ("INVALID", "bold red")
        line = f" {report.run_id}: {report.status}, {report.files_checked} files checked, "
        line += f"{report.samples_in_journal} samples and {report.readings_in_journal} readings"
        console.print(Text.assemble((word, style), f"{line} acknowledged"), soft_wrap=True)
        for problem in report.problems:
            console.print(Text(f"  {problem}"), soft_wrap=True)
        if report.torn_bytes:
            console.print(f"  {report.torn_bytes} bytes at the end were never acknowledged")
        if report.recoverable:
            recover = f"hdbench runs verify --recover {shlex.quote(str(run))}"
            console.print(Text(f"  its data can be recovered: {recover}"), soft_wrap=True)


@command.command(
    "verify", epilog="Example: hdbench runs verify runs/20261121T101500Z-ripple-3f9a1c --recover"
)
@click.argument("runs", metavar="RUN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--recover", is_flag=True, help="Write trace or loads of a killed run.")
@click.pass_obj
def verify(output: Output, runs: tuple[Path, ...], recover: bool) -> int:
    """Read runs in full and compare them with their hashes; exit 4 if one is invalid."""
    from hdbench.records import result_header, verify_runs

    reports = verify_runs(runs, recover=recover)
    ok = all(report.ok for report in reports)
    output.result(
        {
            **result_header("verify", None),
            "ok": ok,
            "runs": [report.to_dict() for report in reports],
        },
        lambda console: _draw_checks(console, runs, reports),
    )
    return 0 if ok else 4


@command.command(
    "resume", epilog="Example: hdbench runs resume runs/20261121T101500Z-calibration-3f9a1c"
)
@click.argument("run", metavar="RUN", type=click.Path(path_type=Path))
@address_option
@control_option
@click.option("--yes", is_flag=True, help="Confirm motion without a question.")
@click.option("--no-input", is_flag=True, help="Never ask; fail where an answer is needed.")
@click.option("--check", is_flag=True, help="Exit 3 unless the result passes.")
@click.option("--realtime", is_flag=True, default=None, help="Let the embedded bench keep time.")
@click.option("--no-report", is_flag=True, help="Leave out report.html.")
@click.option(
    "--operator",
    "who",
    type=click.Choice(["auto", "person", "simulated"]),
    default="auto",
    show_default=True,
    help="Who answers at a calibration, as for hdbench calibrate.",
)
@mistakes_option
@click.pass_obj
def resume(output: Output, /, run: Path, **options: Any) -> None:
    """Go on with a run that was stopped, killed, or lost its bench, in the same folder.

    A calibration goes on at the weight where it stopped; what was accepted is not asked again. A
    run with motion keeps every acquisition that came to its end; one that was broken off is taken
    again from standstill, its first samples kept beside it.
    """
    from hdbench_cli.commands.resume import Resume, resume_command

    resume_command(output, Resume(run=run, **options))


for child in (list_, note, compare):
    command.add_command(child)
