"""`hdbench response`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.options import profile_option
from hdbench_cli.output import Output
from hdbench_cli.parameters import speeds

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.profile import Profile

__all__ = ["command"]

_INJECTED_HZ = (0.0, 0.5, 2.0, 10.0)


def _speeds(profile: Profile) -> tuple[float, float]:
    """Return the speeds of the bench's two dynamic experiments, rad/s."""
    ripple = profile.data.ripple.reference
    fast = abs(ripple.amplitude_v) * profile.data.servo.velocity_gain_rad_s_per_v
    return abs(profile.data.misalignment.velocity_rad_s), fast


@click.command(
    "response", epilog="Example: hdbench response --model report-6 --velocity 50 --velocity 156"
)
@click.option(
    "--model",
    "filter_name",
    metavar="NAME|FILE",
    help="Filter model: report-a1, report-a2, report-6 or a model file; else the profile's.",
)
@click.option(
    "--velocity",
    "velocities",
    metavar="RAD/S",
    multiple=True,
    callback=speeds,
    help="Motor velocity; may be repeated, or 50,156.  [default: those of the profile's "
    "experiments]",
)
@click.option(
    "--period",
    "period_s",
    metavar="S",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Sampling period.  [default: the profile's]",
)
@click.option(
    "--plot",
    metavar="FILE.svg",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Picture to write, .svg or .png.",
)
@profile_option
@click.pass_obj
def command(
    output: Output,
    filter_name: str | None,
    velocities: tuple[float, ...],
    period_s: float | None,
    plot: Path | None,
    profile_name: str | None,
) -> None:
    """Show what a tuning does to the torque: notches, torque passed, noise, memory.

    The exact transfer function from measured to filtered torque at constant speed, from the steady
    Kalman gain, beside sinusoids sent through the running filter.
    """
    from hdbench.filter.response import filter_response, inject
    from hdbench.records import result_header
    from hdbench.session.filters import choose_filter
    from hdbench_cli.commands.experiment import choose_profile

    profile = choose_profile(profile_name, None)
    model = choose_filter(profile, filter_name)
    period = period_s or profile.data.daq.sample_period_s
    responses = []
    for velocity in velocities or _speeds(profile):
        item = filter_response(model, velocity, period).to_dict()
        probes = inject(model, velocity, period, [f for f in _INJECTED_HZ if f < 0.5 / period])
        item["injection"] = [
            {"frequency_hz": p.frequency_hz, "measured": p.measured, "algebra": p.algebra}
            for p in probes
        ]
        responses.append(item)
    body = {
        **result_header("response", profile),
        "sample_period_s": period,
        "responses": responses,
        "filter": model.to_dict(),
    }
    if plot is not None:
        from hdbench.report.plots import plot_response

        plot_response(plot, model.name, responses)
        body["plot"] = str(plot)
    output.result(body, lambda console: _show(console, body))


def _show(console: Console, body: dict[str, Any]) -> None:
    from rich.table import Table

    for item in body["responses"]:
        settling = item["settling_time_s"]
        memory = "never" if settling is None else f"{settling:.3g} s"
        title = f"{body['filter']['name']} at {item['velocity_rad_s']:g} rad/s: "
        title += f"white noise times {item['noise_gain']:.3f}, settled to 2 % after {memory}"
        console.print(title, markup=False, highlight=False, soft_wrap=True)
        table = Table("frequency", "|H|", "|H| by injection", "phase", box=None, pad_edge=False)
        injected = {p["frequency_hz"]: p["measured"] for p in item["injection"]}
        for p in item["passed"]:
            measured = injected.get(p["frequency_hz"])
            table.add_row(
                f"{p['frequency_hz']:g} Hz",
                f"{p['gain']:.3f}",
                "" if measured is None else f"{measured:.3f}",
                f"{57.29577951308232 * p['phase_rad']:+.1f} deg",
            )
        console.print(table)
        for n in item["notches"]:
            width = "none: half power is not reached on both sides before the next notch"
            if n["width_hz"] is not None:
                width = f"{n['width_hz']:.3g} Hz"
            text = (
                f"notch {n['name']} at {n['frequency_hz']:.4g} Hz, {n['depth_db']:.0f} dB, width "
            )
            console.print(text + width, markup=False, highlight=False, soft_wrap=True)
    if "plot" in body:
        console.print(f"picture: {body['plot']}", markup=False, highlight=False, soft_wrap=True)
