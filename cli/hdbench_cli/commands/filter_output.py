"""What `hdbench filter` adds on request: smoothed orders, filters side by side, a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from hdbench.filter import FilterModel
    from hdbench.filter.comparison import Comparison
    from hdbench.filter.smoothing import SmoothedTorque
    from hdbench.profile import Profile
    from hdbench.records import Trace

__all__ = [
    "TRUTH",
    "compare",
    "compared_columns",
    "draw_comparison",
    "show_comparison",
    "show_orders",
    "smoothed_columns",
    "smoothed_summary",
]

TRUTH = "torque_true_nm"
"""Column of a simulated trace with the true torque, N m."""


def smoothed_columns(trace: Trace, smoothed: SmoothedTorque) -> Trace:
    """Add the smoothed torque, and every order's amplitude and phase with their bands."""
    columns = {"torque_smoothed_nm": smoothed.torque_smoothed_nm}
    columns |= {"slow_nm": smoothed.slow_nm, "slow_std_nm": smoothed.slow_std_nm}
    for wave in smoothed.waves:
        columns |= {
            f"{wave.name}_amplitude_nm": wave.amplitude_nm,
            f"{wave.name}_amplitude_std_nm": wave.amplitude_std_nm,
            f"{wave.name}_phase_rad": wave.phase_rad,
            f"{wave.name}_phase_std_rad": wave.phase_std_rad,
        }
    return trace.with_columns(**columns)


def smoothed_summary(smoothed: SmoothedTorque) -> list[dict[str, Any]]:
    """Return every order's amplitude over the trace: mean, least, most, and its mean band."""
    import numpy as np

    rows = []
    for wave in smoothed.waves:
        known = wave.amplitude_nm[np.isfinite(wave.amplitude_nm)]
        band = wave.amplitude_std_nm[np.isfinite(wave.amplitude_std_nm)]
        rows.append(
            {
                "name": wave.name,
                "role": wave.role,
                "order": wave.order,
                "frequency_hz": wave.frequency_hz,
                "amplitude_nm": {
                    "mean": float(np.mean(known)),
                    "min": float(np.min(known)),
                    "max": float(np.max(known)),
                    "mean_std": float(np.mean(band)),
                },
            }
        )
    return rows


def compare(trace: Trace, tuned: FilterModel, profile: Profile) -> Comparison:
    """Run raw, low-pass, the report's tuning, the tuned model and its smoother side by side."""
    from hdbench.filter import preset
    from hdbench.filter.comparison import compare_filters
    from hdbench.session.filters import trace_channels

    settings = profile.data.filter
    return compare_filters(
        trace_channels(trace, profile, use_measured_angle=True),
        {"report": preset("report-6", profile.data)},
        tuned,
        truth_nm=trace.columns.get(TRUTH),
        lowpass=(settings.butterworth_cutoff_hz, settings.butterworth_order),
    )


def compared_columns(trace: Trace, comparison: Comparison) -> Trace:
    """Add one column per contender but the raw torque, which is there."""
    return trace.with_columns(
        **{
            f"torque_{row.name}_nm": row.torque_nm
            for row in comparison.contenders
            if row.name != "raw"
        }
    )


def draw_comparison(path: Path, trace: Trace, comparison: Comparison) -> None:
    """Draw the contenders over time."""
    from hdbench.report.plots import plot_comparison

    torques = {row.name: row.torque_nm for row in comparison.contenders}
    if TRUTH in trace:
        torques = {"truth": trace[TRUTH], **torques}
    plot_comparison(path, trace.time_s, torques)


def show_comparison(console: Console, body: dict[str, Any]) -> None:
    """Print the comparison as a table."""
    from rich.table import Table

    rows = body["rows"]
    places = list(rows[0]["suppression_db"])
    table = Table(
        "",
        *(f"{place} dB" for place in places),
        "torque kept",
        "delay ms",
        "noise N m",
        "error N m",
        box=None,
        pad_edge=False,
    )
    for row in rows:
        kept, delay = row["torque_kept"], row["delay_s"]
        table.add_row(
            row["name"],
            *("" if x is None else f"{x:.1f}" for x in map(row["suppression_db"].get, places)),
            "" if kept is None else f"{kept:.3f}",
            "" if delay is None else f"{1e3 * delay:+.1f}",
            f"{row['noise_nm']:.4f}",
            f"{row['error_rms_nm']:.4f}",
        )
    console.print(table)
    against = "the trace's true torque" if body["reference"] == "truth" else "the smoothed torque"
    text = f"judged from {body['from_s']:.3g} s on against {against}"
    console.print(text, markup=False, highlight=False, soft_wrap=True)


def show_orders(console: Console, rows: list[dict[str, Any]]) -> None:
    """Print every order's amplitude."""
    for row in rows:
        a = row["amplitude_nm"]
        text = f"{row['name']:<14}{a['mean']:.4f} N m +- {a['mean_std']:.4f}"
        text += f", {a['min']:.4f} ... {a['max']:.4f}"
        console.print(text, markup=False, highlight=False, soft_wrap=True)
