"""`hdbench calibrate`."""

from __future__ import annotations

from collections.abc import Mapping
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


def summary(console: Console, result: Mapping[str, Any]) -> None:
    """Draw gain, consistency and acceptance."""
    from hdbench_cli.numbers import with_uncertainty

    console.print(f"gain         {with_uncertainty(result['gain_nm_per_v'], 'N m/V')}")
    if result["consistency"] is not None:
        low, high = result["consistency_interval"] or (None, None)
        between = f"  (95 %: {low:.2%} to {high:.2%})" if low is not None else ""
        console.print(f"consistency  {result['consistency']:.2%}{between}")
    console.print(f"accepted     {'yes' if result['accepted'] else 'no'}")


def failed(result: Mapping[str, Any]) -> str | None:
    """Return why the calibration is not accepted, or None."""
    if result["accepted"]:
        return None
    return f"calibration not accepted: consistency {result['consistency']}"


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
