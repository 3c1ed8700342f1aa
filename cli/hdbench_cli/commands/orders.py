"""`hdbench orders`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hdbench.filter import filter_channels, orders
from hdbench.filter.presets import choose_filter
from hdbench.records import Trace, result_header, write_atomic, write_trace
from hdbench.records.csvtext import csv_text
from hdbench_cli.commands.filter import (
    order_lines,
    smoothed_columns,
    smoothed_summary,
)
from hdbench_cli.commands.tune import tuned_on
from hdbench_cli.inputs import check_out, choose_profile, read_input, show_results, targets
from hdbench_cli.output import Output


def _write_map(path: Path, found: orders.OrderMap) -> None:
    """Write the order map, one row per window and order."""
    windows = zip(found.time_s, found.speed_rad_s, found.amplitude_nm, strict=True)
    rows = (
        [f"{number:.9g}" for number in (time, speed, order, amplitude)]
        for time, speed, line in windows
        for order, amplitude in zip(found.order, line, strict=True)
    )
    head = ("time_s", "motor_velocity_rad_s", "order", "amplitude_nm")
    write_atomic(path, csv_text(head, rows).encode())


def orders_command(
    output: Output, /, sources: tuple[Path, ...], out: Path | None, **options: Any
) -> None:
    """Show the torque by order: spectrum over the motor angle, map, every order over time."""
    files = [None] * len(sources) if out is None else targets(out, sources)
    bodies = [_orders(*pair, **options) for pair in zip(sources, files, strict=True)]
    show_results(output, bodies, out, _lines)


def _orders(
    source: Path,
    out: Path | None,
    *,
    filter_name: str | None,
    profile_name: str | None,
    max_order: float,
    map_file: Path | None,
    plot: Path | None,
    **scaling: Any,
) -> dict[str, Any]:
    """Return the result of one input, and write its files."""
    files = {"orders": out, "map": map_file, "plot": plot}
    profile = choose_profile(profile_name, source)
    item = read_input(source, profile, **scaling)
    for target in files.values():
        if target is not None:
            check_out(target, source, item.file)
    named = filter_name not in (None, "tuned")
    model = choose_filter(profile, filter_name) if named else tuned_on(item, profile)
    channels = filter_channels(
        item.trace, profile.data, use_measured_angle=model.use_measured_angle
    )
    spectrum = orders.order_spectrum(channels, channels.torque_nm, highest_order=max_order)
    found = orders.order_map(channels, channels.torque_nm, highest_order=max_order)
    smoothed = orders.smooth_channels(model, channels)
    if out is not None:
        base = Trace({"time_s": channels.time_s}, source=channels.source)
        write_trace(out, smoothed_columns(base, smoothed))
    if map_file is not None:
        _write_map(map_file, found)
    if plot is not None:
        from hdbench.report.plots import plot_orders

        waves = {
            wave.name: (channels.time_s, wave.amplitude_nm, wave.amplitude_std_nm)
            for wave in smoothed.waves
        }
        plot_orders(plot, (spectrum.order, spectrum.amplitude_nm), waves)
    windows = {"windows": len(found.time_s), "turns": found.turns, "orders": len(found.order)}
    return {
        **result_header("orders", profile),
        "input": item.identity(),
        "torque_scale": item.scale.to_dict(),
        "angle": "measured" if channels.angle_rad is not None else "integrated velocity",
        **_spectrum(spectrum),
        "tracked": smoothed_summary(smoothed),
        "map": windows,
        "files": {name: str(path) for name, path in files.items() if path is not None},
        "filter": model.to_dict(),
    }


def _spectrum(spectrum: orders.OrderSpectrum) -> dict[str, Any]:
    least, mean, most = spectrum.speed_rad_s
    return {
        "stretch": {"from_s": spectrum.from_s, "to_s": spectrum.to_s, "turns": spectrum.turns},
        "motor_velocity_rad_s": {"min": least, "mean": mean, "max": most},
        "peaks": [peak.to_json() for peak in spectrum.peaks],
        "spectrum": {
            "order": spectrum.order.tolist(),
            "amplitude_nm": spectrum.amplitude_nm.tolist(),
        },
    }


def _lines(body: Mapping[str, Any]) -> Iterator[str]:
    stretch, speed = body["stretch"], body["motor_velocity_rad_s"]
    yield (
        f"{stretch['turns']:.1f} motor turns, {stretch['from_s']:.3g} ... "
        f"{stretch['to_s']:.3g} s, {speed['min']:.4g} ... {speed['max']:.4g} rad/s, "
        f"angle: {body['angle']}"
    )
    for peak in body["peaks"][:10]:
        amplitude = f"{peak['amplitude_nm']:.4f} N m"
        yield f"peak  order {peak['order']:<9.4g} {amplitude}  {peak['name'] or ''}"
    yield from order_lines(body["tracked"])
    yield from (f"{name}: {file}" for name, file in body["files"].items())
