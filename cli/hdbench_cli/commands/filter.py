"""`hdbench filter`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from hdbench.errors import DoubtfulDataError
from hdbench_cli.options import calibration_option, model_option, profile_option
from hdbench_cli.output import Output

__all__ = ["command"]


@click.command("filter", epilog="Example: hdbench filter runs/RUN --model report-6 --out clean.csv")
@click.argument(
    "sources", metavar="TRACE|RUN...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@model_option
@profile_option
@calibration_option
@click.option(
    "--gain",
    metavar="N·m/V",
    type=float,
    help="Gain that scales torque_v; else that of calibration, run, model or profile.",
)
@click.option(
    "--out",
    metavar="FILE.csv|DIR",
    type=click.Path(path_type=Path),
    required=True,
    help="Trace file to write (.csv or .csv.gz); for several inputs the folder of such files.",
)
@click.option(
    "--smooth",
    is_flag=True,
    help="Add columns: smoothed torque, every order's amplitude and phase with their bands.",
)
@click.option(
    "--compare",
    is_flag=True,
    help="Raw, low-pass, the report's tuning, tuned and smoothed side by side.",
)
@click.option(
    "--plot",
    metavar="FILE.svg",
    type=click.Path(path_type=Path, dir_okay=False),
    help="With --compare: picture to write, .svg or .png.",
)
@click.pass_obj
def command(
    output: Output,
    sources: tuple[Path, ...],
    filter_name: str | None,
    profile_name: str | None,
    calibration: Path | None,
    gain: float | None,
    out: Path,
    smooth: bool,
    compare: bool,
    plot: Path | None,
) -> None:
    """Take ripple and misalignment out of stored traces.

    A run is filtered by the filter that ran in it and gives the same bits, unless --model or
    another profile says otherwise. Of several inputs each is written to the folder --out under its
    own name. Exits 6 where samples are missing, saturated or apart: the file is written, and its
    torque is nan where it is missing.
    """
    from hdbench_cli.commands.filtering import Request, filter_input, show_filtered
    from hdbench_cli.inputs import targets

    if gain is not None and calibration is not None:
        raise click.UsageError("--gain and --calibration both name a gain; give one")
    if plot is not None and not compare:
        raise click.UsageError("--plot draws the comparison; ask for --compare too")
    if plot is not None and len(sources) > 1:
        raise click.UsageError("--plot draws one input; filter them one by one")
    request = Request(filter_name, profile_name, calibration, gain, smooth, compare, plot)
    files = targets(out, sources)
    bodies = [filter_input(request, *pair) for pair in zip(sources, files, strict=True)]
    if len(bodies) == 1:
        output.result(bodies[0], lambda console: show_filtered(console, bodies[0]))
    else:
        from hdbench_cli.inputs import show_each, together

        body = together(bodies, out)
        output.result(body, lambda console: show_each(console, bodies, show_filtered))
    _doubts(output, bodies)


def _doubts(output: Output, bodies: list[dict[str, Any]]) -> None:
    """Exit 6 where an input was doubtful, and say which."""
    doubtful = [body for body in bodies if body["flags"]]
    if not doubtful:
        return
    fix = "look at the marked samples, then measure again"
    if any(flag["name"] == "wrong-channel" for body in doubtful for flag in body["flags"]):
        fix = "bring the file in with the right columns and units: hdbench import --map"
    doubt = DoubtfulDataError(
        "; ".join(flag["detail"] for body in doubtful for flag in body["flags"]),
        where=", ".join(body["input"]["path"] for body in doubtful),
        fix=fix,
    )
    if output.json:
        output.note(str(doubt))
        raise click.exceptions.Exit(doubt.exit_code)
    raise doubt
