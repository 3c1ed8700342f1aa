"""`hdbench run-misalignment`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.commands.experiment import Request, run_command
from hdbench_cli.commands.outcome import doubts_of
from hdbench_cli.options import (
    allow_expired_option,
    bench_options,
    calibration_option,
    model_option,
    plan_option,
)
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["command", "failed", "show"]


def show(console: Console, result: Mapping[str, Any]) -> None:
    """Draw a misalignment result."""
    from hdbench_cli.numbers import show_remarks, with_uncertainty

    console.print("Misalignment torque, once per output turn")
    console.print(f"amplitude     {with_uncertainty(result['amplitude_nm'], 'N m')}")
    console.print(f"peak to peak  {with_uncertainty(result['peak_to_peak_nm'], 'N m')}")
    console.print(f"phase         {with_uncertainty(result['phase_rad'], 'rad')}")
    for when in ("before", "after"):
        peak = result[when]["peak_to_peak_nm"]
        console.print(f"{when + ' filter':13s} {with_uncertainty(peak, 'N m')} peak to peak")
    console.print(f"output turns  {result['output_turns']:.2f}")
    show_remarks(console, result)


def failed(result: Mapping[str, Any]) -> str | None:
    """Return why the result does not pass, or None: any doubt fails."""
    return "; ".join(doubts_of(result)) or None


@click.command(
    "run-misalignment",
    epilog="Example: hdbench run-misalignment --calibration runs/RUN --yes",
)
@bench_options
@calibration_option
@allow_expired_option
@model_option
@plan_option
@click.pass_obj
def command(output: Output, /, **options: Any) -> None:
    """Measure the misalignment torque at constant velocity, both directions.

    The load turns at least two whole turns each way; amplitude and phase of the torque once per
    output turn feed the filter's output-order block.
    """
    request = Request(kind="misalignment", out=Path(options.pop("out")), **options)
    run_command(output, request, show, failed)
