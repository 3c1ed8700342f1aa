"""`hdbench run-ripple`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.commands.experiment import Request, run_command
from hdbench_cli.commands.run_misalignment import failed
from hdbench_cli.options import (
    allow_expired_option,
    bench_options,
    calibration_option,
    model_option,
    plan_option,
)
from hdbench_cli.output import Output
from hdbench_cli.parameters import StoredPath

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["command", "show"]


def show(console: Console, result: Mapping[str, Any]) -> None:
    """Draw a ripple result."""
    from hdbench_cli.numbers import probability, show_remarks, with_uncertainty

    console.print("Torque ripple")
    taken = {entry["order"]: entry["suppression_db"] for entry in result["suppression_db"]}
    for line in result["ripple"]:
        order = line["order"]
        console.print(f"order {order:<7g} {with_uncertainty(line['amplitude_nm'], 'N m')}")
        console.print(f"  phase       {with_uncertainty(line['phase_rad'], 'rad')}")
        if taken.get(order) is not None:
            console.print(f"  filter      takes {taken[order]:.1f} dB")
    for line in result.get("lines", ()):
        console.print(
            f"also {line['order']:<8.4g} {with_uncertainty(line['amplitude_nm'], 'N m')}"
            f"  false alarm {probability(line['false_alarm_probability'])}"
        )
    for tone in result.get("tones", ()):
        console.print(
            f"tone {tone['frequency_hz']:<5.4g} Hz {with_uncertainty(tone['amplitude_nm'], 'N m')}"
            f"  false alarm {probability(tone['false_alarm_probability'])}"
        )
    rms = result["torque_rms_nm"]
    console.print(
        f"torque rms    {rms['measured']:.4f} measured, {rms['filtered']:.4f} filtered N m"
    )
    show_remarks(console, result)


@click.command(
    "run-ripple",
    epilog="Example: hdbench run-ripple --calibration runs/RUN --misalignment runs/RUN --yes",
)
@bench_options
@calibration_option
@allow_expired_option
@click.option(
    "--misalignment",
    metavar="RUN|FILE",
    type=StoredPath(),
    help="Misalignment result whose output-order block joins the online filter.",
)
@model_option
@plan_option
@click.option(
    "--velocity-above",
    metavar="RAD/S",
    type=click.FloatRange(min=0.0),
    help="Evaluate only samples with the motor faster than this.",
)
@click.option("--from-s", metavar="S", type=float, help="Evaluate from this time on.")
@click.option("--to-s", metavar="S", type=float, help="Evaluate up to this time.")
@click.pass_obj
def command(
    output: Output,
    /,
    velocity_above: float | None,
    from_s: float | None,
    to_s: float | None,
    **options: Any,
) -> None:
    """Measure the torque ripple in free motion with the reference generator.

    Amplitudes and phases at twice and four times motor speed, the power spectrum of a steady
    stretch, and how much of it the filter takes away. With --plan the motion is that of a plan
    file, held against the same limits.
    """
    from hdbench.ripple import Stretch

    stretch = Stretch(velocity_above, from_s, to_s)
    request = Request(kind="ripple", out=Path(options.pop("out")), stretch=stretch, **options)
    run_command(output, request, show, failed)
