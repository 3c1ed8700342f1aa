"""`hdbench run-misalignment`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from hdbench_cli.commands.experiment import Request, doubts_of, run
from hdbench_cli.options import EXPERIMENT, declared
from hdbench_cli.output import Output
from hdbench_cli.text import remark_lines, with_uncertainty


def lines(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield a misalignment result."""
    yield "Misalignment torque, once per output turn"
    yield f"amplitude     {with_uncertainty(result['amplitude_nm'], 'N m')}"
    yield f"peak to peak  {with_uncertainty(result['peak_to_peak_nm'], 'N m')}"
    yield f"phase         {with_uncertainty(result['phase_rad'], 'rad')}"
    for when in ("before", "after"):
        peak = with_uncertainty(result[when]["peak_to_peak_nm"], "N m")
        yield f"{when + ' filter':13s} {peak} peak to peak"
    yield f"output turns  {result['output_turns']:.2f}"
    yield from remark_lines(result)


def failed(result: Mapping[str, Any]) -> str | None:
    """Return why the result does not pass, or None: any doubt fails."""
    return "; ".join(doubts_of(result)) or None


@declared("run-misalignment", f"{EXPERIMENT} calibration allow_expired filter_name plan_file")
def command(output: Output, /, **options: Any) -> None:
    """Measure the misalignment torque at constant velocity, both directions.

    The load turns at least two whole turns each way; amplitude and phase of the torque once per
    output turn feed the filter's output-order block.
    """
    run(output, Request("misalignment", **options))
