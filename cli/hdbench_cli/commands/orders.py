"""`hdbench orders`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hdbench_cli.options import calibration_option, profile_option
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.filter import Channels, FilterModel
    from hdbench.filter.orders import OrderMap, OrderSpectrum
    from hdbench.filter.smoothing import SmoothedTorque
    from hdbench.profile import Profile
    from hdbench.records import Trace
    from hdbench_cli.inputs import Input

__all__ = ["command"]


def _model(name: str | None, item: Input, profile: Profile) -> FilterModel:
    """Return the model that tracks the orders: tuned on the trace unless one is named."""
    from hdbench.filter.tuning import settings_of
    from hdbench.session.filters import choose_filter
    from hdbench_cli.commands.tune import tune_inputs

    if name not in (None, "tuned"):
        return choose_filter(profile, name)
    base = choose_filter(profile, None)
    return tune_inputs([item], base, settings_of(profile.data), profile).model


def _waves(channels: Channels, smoothed: SmoothedTorque) -> Trace:
    """Return every order over time as a trace to be written."""
    from hdbench.records import Trace
    from hdbench_cli.commands.filter_output import smoothed_columns

    base = Trace({"time_s": channels.time_s}, source=channels.source)
    return smoothed_columns(base, smoothed)


def _write_map(path: Path, found: OrderMap) -> None:
    """Write the order map, one row per window and order."""
    from hdbench.records import write_atomic

    rows = ["time_s,motor_velocity_rad_s,order,amplitude_nm"]
    for time, speed, line in zip(found.time_s, found.speed_rad_s, found.amplitude_nm, strict=True):
        head = f"{float(time):.9g},{float(speed):.9g}"
        rows += [
            f"{head},{float(order):.9g},{float(amplitude):.9g}"
            for order, amplitude in zip(found.order, line, strict=True)
        ]
    write_atomic(path, ("\n".join(rows) + "\n").encode())


@click.command("orders", epilog="Example: hdbench orders runs/RUN --out orders.csv")
@click.argument(
    "sources", metavar="TRACE|RUN...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option(
    "--model",
    "filter_name",
    metavar="NAME|FILE",
    help="Filter model whose orders are tracked.  [default: the profile's, tuned on this trace]",
)
@profile_option
@calibration_option
@click.option("--gain", metavar="N·m/V", type=float, help="Gain that scales torque_v.")
@click.option(
    "--max-order",
    metavar="ORDER",
    type=click.FloatRange(min=0.0, min_open=True),
    default=12.0,
    show_default=True,
    help="Highest order of spectrum and map.",
)
@click.option(
    "--out",
    metavar="FILE.csv|DIR",
    type=click.Path(path_type=Path),
    help="Every order over time: amplitude, phase, their bands; for several inputs the folder of "
    "such files.",
)
@click.option(
    "--map",
    "map_file",
    metavar="FILE.csv",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Order map: amplitude over time and order.",
)
@click.option(
    "--plot",
    metavar="FILE.svg",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Picture to write, .svg or .png.",
)
@click.pass_obj
def command(
    output: Output,
    sources: tuple[Path, ...],
    filter_name: str | None,
    profile_name: str | None,
    calibration: Path | None,
    gain: float | None,
    max_order: float,
    out: Path | None,
    map_file: Path | None,
    plot: Path | None,
) -> None:
    """Show the torque by order: spectrum over the motor angle, map, every order over time.

    The angle is the encoder's where there is one, else the integrated velocity. Amplitude and phase
    over time come from the smoother, with their bands.
    """
    from hdbench_cli.inputs import show_each, targets, together

    if len(sources) > 1 and (map_file is not None or plot is not None):
        raise click.UsageError("--map and --plot are of one input; give them one by one")
    request = _Request(filter_name, profile_name, calibration, gain, max_order, map_file, plot)
    files = [None] * len(sources) if out is None else targets(out, sources)
    bodies = [_one(request, *pair) for pair in zip(sources, files, strict=True)]
    if len(bodies) == 1:
        output.result(bodies[0], lambda console: _show(console, bodies[0]))
        return
    output.result(together(bodies, out), lambda console: show_each(console, bodies, _show))


@dataclass(frozen=True, slots=True)
class _Request:
    """What is asked of every input."""

    filter_name: str | None
    profile_name: str | None
    calibration: Path | None
    gain: float | None
    max_order: float
    map_file: Path | None
    plot: Path | None


def _one(request: _Request, source: Path, out: Path | None) -> dict[str, Any]:
    """Return the result of one input, and write its files."""
    from hdbench.filter.orders import order_map, order_spectrum
    from hdbench.filter.smoothing import smooth_channels
    from hdbench.records import result_header, write_trace
    from hdbench.session.filters import trace_channels
    from hdbench_cli.commands.experiment import choose_profile
    from hdbench_cli.commands.filter_output import smoothed_summary
    from hdbench_cli.inputs import check_out, read_input

    files = {"orders": out, "map": request.map_file, "plot": request.plot}
    profile = choose_profile(request.profile_name, source)
    item = read_input(source, profile, gain=request.gain, calibration=request.calibration)
    for target in files.values():
        if target is not None:
            check_out(target, source, item.file)
    model = _model(request.filter_name, item, profile)
    channels = trace_channels(item.trace, profile, use_measured_angle=model.use_measured_angle)
    spectrum = order_spectrum(channels, channels.torque_nm, highest_order=request.max_order)
    found = order_map(channels, channels.torque_nm, highest_order=request.max_order)
    smoothed = smooth_channels(model, channels)
    if out is not None:
        write_trace(out, _waves(channels, smoothed))
    if request.map_file is not None:
        _write_map(request.map_file, found)
    if request.plot is not None:
        _draw(request.plot, channels, spectrum, smoothed)
    return {
        **result_header("orders", profile),
        "input": item.identity(),
        "torque_scale": item.scale.to_dict(),
        "angle": "measured" if channels.angle_rad is not None else "integrated velocity",
        **_spectrum_body(spectrum),
        "tracked": smoothed_summary(smoothed),
        "map": {
            "windows": len(found.time_s),
            "turns": found.turns,
            "orders": len(found.order),
        },
        "files": {name: str(path) for name, path in files.items() if path is not None},
        "filter": model.to_dict(),
    }


def _spectrum_body(spectrum: OrderSpectrum) -> dict[str, Any]:
    least, mean, most = spectrum.speed_rad_s
    return {
        "stretch": {"from_s": spectrum.from_s, "to_s": spectrum.to_s, "turns": spectrum.turns},
        "motor_velocity_rad_s": {"min": least, "mean": mean, "max": most},
        "peaks": [peak.to_dict() for peak in spectrum.peaks],
        "spectrum": {
            "order": spectrum.order.tolist(),
            "amplitude_nm": spectrum.amplitude_nm.tolist(),
        },
    }


def _draw(
    path: Path, channels: Channels, spectrum: OrderSpectrum, smoothed: SmoothedTorque
) -> None:
    from hdbench.report.plots import plot_orders

    waves = {
        wave.name: (channels.time_s, wave.amplitude_nm, wave.amplitude_std_nm)
        for wave in smoothed.waves
    }
    plot_orders(path, (spectrum.order, spectrum.amplitude_nm), waves)


def _show(console: Console, body: dict[str, Any]) -> None:
    from hdbench_cli.commands.filter_output import show_orders

    stretch, speed = body["stretch"], body["motor_velocity_rad_s"]
    text = f"{stretch['turns']:.1f} motor turns, {stretch['from_s']:.3g} ... "
    text += f"{stretch['to_s']:.3g} s, {speed['min']:.4g} ... {speed['max']:.4g} rad/s, "
    text += f"angle: {body['angle']}"
    console.print(text, markup=False, highlight=False, soft_wrap=True)
    for peak in body["peaks"][:10]:
        name = peak["name"] or ""
        text = f"peak  order {peak['order']:<9.4g} {peak['amplitude_nm']:.4f} N m  {name}"
        console.print(text, markup=False, highlight=False, soft_wrap=True)
    show_orders(console, body["tracked"])
    for name, file in body["files"].items():
        console.print(f"{name}: {file}", markup=False, highlight=False, soft_wrap=True)
