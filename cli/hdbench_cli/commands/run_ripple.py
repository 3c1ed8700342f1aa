"""`hdbench run-ripple`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from hdbench_cli.commands.experiment import Request, run
from hdbench_cli.commands.run_misalignment import failed
from hdbench_cli.options import EXPERIMENT, declared
from hdbench_cli.output import Output
from hdbench_cli.text import probability, remark_lines, with_uncertainty

__all__ = ["command", "failed", "lines"]


def lines(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield a ripple result."""
    yield "Torque ripple"
    taken = {entry["order"]: entry["suppression_db"] for entry in result["suppression_db"]}
    for line in result["ripple"]:
        order = line["order"]
        yield f"order {order:<7g} {with_uncertainty(line['amplitude_nm'], 'N m')}"
        yield f"  phase       {with_uncertainty(line['phase_rad'], 'rad')}"
        if taken.get(order) is not None:
            yield f"  filter      takes {taken[order]:.1f} dB"
    others = [(f"also {line['order']:<8.4g}", line) for line in result.get("lines", ())]
    others += [(f"tone {t['frequency_hz']:<5.4g} Hz", t) for t in result.get("tones", ())]
    for head, line in others:
        yield (
            f"{head} {with_uncertainty(line['amplitude_nm'], 'N m')}"
            f"  false alarm {probability(line['false_alarm_probability'])}"
        )
    rms = result["torque_rms_nm"]
    yield f"torque rms    {rms['measured']:.4f} measured, {rms['filtered']:.4f} filtered N m"
    yield from remark_lines(result)


@declared(
    "run-ripple",
    f"{EXPERIMENT} calibration allow_expired misalignment filter_name plan_file velocity_above "
    "from_s to_s",
)
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

    run(output, Request("ripple", stretch=Stretch(velocity_above, from_s, to_s), **options))
