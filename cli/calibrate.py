"""`hdbench calibrate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.experiment import Request, run_command
from hdbench_cli.options import bench_options
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["command", "failed", "show", "summary"]


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
    console.print(f"accepted     {'yes' if result['accepted'] else 'no'}")


def failed(result: Mapping[str, Any]) -> str | None:
    """Return why the calibration is not accepted, or None."""
    if result["accepted"]:
        return None
    if result["consistency"] is None:
        return "calibration not accepted: one loading experiment has no consistency; needed: two"
    return (
        f"calibration not accepted: consistency {result['consistency']:.2%}; needed: at most "
        f"{result['max_consistency']:.2%}"
    )


@click.command(
    "calibrate",
    epilog="Example: hdbench calibrate --dry-run; hdbench calibrate --from loads.csv --json",
)
@bench_options
@click.pass_obj
def command(output: Output, /, **options: Any) -> None:
    """Calibrate the torque sensor by arm and weights with locked wave generator.

    Positions, directions and load ranges come from the profile; each is loaded and unloaded. The
    drive stays disabled; an encoder that moves stops the experiment.
    """
    request = Request(kind="calibration", out=Path(options.pop("out")), **options)
    run_command(output, request, show, failed)
