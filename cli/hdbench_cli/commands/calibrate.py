"""`hdbench calibrate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.commands.experiment import Request, run_command
from hdbench_cli.options import bench_options
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["command", "failed", "mistakes_option", "show", "summary"]

mistakes_option = click.option(
    "--operator-mistakes",
    "mistakes",
    metavar="LIST",
    default="",
    help="What goes wrong at a simulated bench, by point of the sequence: wrong-weight@5, "
    "wrong-weight@5:0.5 (kg), swing@7, early-release@9, comma-separated.",
)


def show(console: Console, result: Mapping[str, Any]) -> None:
    """Draw a calibration result."""
    from rich.table import Table

    from hdbench_cli.numbers import show_remarks

    table = Table(title="Gain per loading experiment", box=None, title_justify="left")
    for name in ("experiment", "gain N m/V", "zero N m", "residual N m", "n"):
        table.add_column(name, justify="left" if name == "experiment" else "right")
    for line in result["experiments"]:
        table.add_row(
            str(line["id"]),
            f"{line['gain_nm_per_v']:.4f}",
            f"{line['intercept_nm']:+.4f}",
            f"{line['residual_rms_nm']:.4f}",
            str(line["n"]),
        )
    console.print(table)
    console.print()
    summary(console, result)
    show_remarks(console, result)


def _between(interval: Sequence[float | None] | None) -> str:
    """Return the interval in words; its upper end is open where few gains spread widely."""
    low, high = interval or (None, None)
    if low is None:
        return ""
    return (
        f"  (95 %: {low:.2%} to {high:.2%})" if high is not None else f"  (95 %: above {low:.2%})"
    )


def summary(console: Console, result: Mapping[str, Any]) -> None:
    """Draw gain, consistency and acceptance."""
    from hdbench_cli.numbers import with_uncertainty

    console.print(f"gain         {with_uncertainty(result['gain_nm_per_v'], 'N m/V')}")
    if result["consistency"] is not None:
        between = _between(result["consistency_interval"])
        console.print(f"consistency  {result['consistency']:.2%}{between}")
    _uncertainty(console, result)
    broken = [
        test["name"]
        for test in result.get("acceptance", {}).get("tests", [])
        if test["passed"] is False
    ]
    why = f": {', '.join(broken)} not held" if broken else ""
    console.print(f"accepted     {_ACCEPTED[result['accepted']]}{why}")


_ACCEPTED = {True: "yes", False: "no", None: "not decided"}
_OF = (
    ("mean_of_positions", "mean of positions"),
    ("any_one_position", "any one position"),
    ("naive", "were all experiments independent"),
)


def _uncertainty(console: Console, result: Mapping[str, Any]) -> None:
    """Draw the expanded uncertainties and the class, where the result has them."""
    one = result.get("gain_basis") in ("residual", "repetitions")
    for key, words in _OF:
        body = result.get("uncertainty", {}).get(key)
        if body is not None:
            where = "this position alone" if one and key == "mean_of_positions" else words
            expanded = float(body["expanded"])
            dof = "" if body["dof"] is None else f", {body['dof']:.3g} dof"
            factor = f"k = {body['coverage_factor']:.2f}{dof}"
            console.print(
                f"U (95 %)     {f'{expanded:#.2g}'.rstrip('.')} N m/V "
                f"({body['expanded_relative']:.2%}, {factor})  {where}"
            )
    if result.get("class") is not None:
        console.print(
            f"class        {result['class']:g}, indicative, in the manner of EURAMET cg-14"
        )


def failed(result: Mapping[str, Any]) -> str | None:
    """Return why the calibration is not accepted, or None."""
    if result["accepted"]:
        return None
    tests = result.get("acceptance", {}).get("tests", [])
    broken = [test for test in tests if test["passed"] is False]
    if broken:
        told = [f"{t['name']} {t['value']:.4g}; needed: at most {t['limit']:.4g}" for t in broken]
        return f"calibration not accepted: {', '.join(told)}"
    if result["consistency"] is None:
        return "calibration not accepted: one loading experiment has no consistency; needed: two"
    untested = ", ".join(test["name"] for test in tests if test["passed"] is None)
    return f"calibration not accepted: no data to test {untested or 'the consistency'}"


@click.command(
    "calibrate",
    epilog="Example: hdbench calibrate --preset cg14 --dry-run; hdbench calibrate --no-input "
    "--operator-mistakes wrong-weight@5,swing@7; hdbench calibrate --from loads.csv --json",
)
@bench_options
@click.option(
    "--preset",
    type=click.Choice(["report", "cg14"]),
    help="Sequence: the report's experiments, or in the manner of EURAMET cg-14.  "
    "[default: the profile's]",
)
@click.option(
    "--operator",
    "who",
    type=click.Choice(["auto", "person", "simulated"]),
    default="auto",
    show_default=True,
    help="Who answers: auto asks a person at a real bench, and at a simulated one on a terminal. "
    "simulated needs the embedded bench or --control.",
)
@mistakes_option
@click.pass_obj
def command(output: Output, /, **options: Any) -> None:
    """Calibrate the torque sensor by arm and weights with locked wave generator.

    Positions, directions and load ranges come from the profile; each is loaded and unloaded. The
    drive stays disabled; an encoder that moves stops the experiment. Every accepted reading is
    kept at once: after a stop or a crash, hdbench runs resume goes on at the next weight.
    """
    request = Request(kind="calibration", out=Path(options.pop("out")), **options)
    run_command(output, request, show, failed)
