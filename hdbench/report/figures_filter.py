"""What the filter takes away, and the misalignment signature."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hdbench.records import FloatArray
from hdbench.report.canvas import draw_svg, label_axes, legend_above, new_figure, trend
from hdbench.report.elements import Picture
from hdbench.report.signals import Filtered, Signals, window
from hdbench.report.steady import Steady

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["filter_picture", "signature_picture"]

# turns of the wave generator in a close-up: enough to see orders 2 and 4, few enough to tell them
_ZOOM_TURNS = 4.0


def filter_picture(
    signals: Signals,
    filtered: Filtered,
    lowpass_hz: float | None,
    steady: Steady | None,
    name: str,
    *,
    figure_number: str,
) -> Picture:
    """Draw measured against filtered torque: the whole run and a close-up."""
    figure, (whole, close) = new_figure(2, 4.8)
    lowpass = signals.lowpass_nm if lowpass_hz is not None else None
    for axes, cut in ((whole, slice(None)), (close, _close_up(signals, steady))):
        line, width = (":", 1.1) if axes is close else ("-", 0.7)
        time = signals.time_s[cut]
        torque = signals.torque_nm[cut]
        trend(axes, time, torque, "measured", width=width, line=line, label="measured")
        if lowpass is not None:
            trend(axes, time, lowpass[cut], "lowpass", line="--", label="low-pass")
        trend(axes, time, filtered.torque_nm[cut], "filtered", label="Kalman filtered")
        _limits(axes, torque, filtered.torque_nm[cut])
    label_axes(whole, None, "torque (N·m)")
    legend_above(whole)
    label_axes(close, "time (s)", "torque (N·m)", "close-up")
    rms = _spread(signals, signals.torque_nm, steady), _spread(signals, filtered.torque_nm, steady)
    caption = _filter_caption(filtered, rms, steady, lowpass_hz if lowpass is not None else None)
    alt = (
        f"Measured torque and the smoother output of the Kalman filter {filtered.name} over time; "
        f"scatter falls from {rms[0]:.3f} to {rms[1]:.3f} newton metres."
    )
    title = f"Measured against filtered: {filtered.name} (after figure {figure_number})"
    return Picture(title, caption, alt, draw_svg(figure, name, alt))


def _filter_caption(
    filtered: Filtered, rms: tuple[float, float], steady: Steady | None, lowpass_hz: float | None
) -> str:
    orders = ", ".join(f"{order:g}" for order in filtered.orders)
    how = "computed while the run was sampled" if filtered.online else "computed from the trace"
    where = "In the steady stretch" if steady is not None else "Over the whole run"
    compare = (
        f" The dashed {lowpass_hz:g} Hz Butterworth low-pass also smooths, but lags, and it cannot "
        "tell a slow disturbance from the torque."
        if lowpass_hz is not None
        else ""
    )
    return (
        f"Measured torque (dotted in the close-up) and what the filter {filtered.name} makes of it "
        f"({how}; motor orders {orders}). {where} the torque scatters by {rms[0]:.3f} N·m rms "
        f"measured and {rms[1]:.3f} N·m rms filtered.{compare}"
    )


def _close_up(signals: Signals, steady: Steady | None) -> Any:
    time = signals.time_s
    if steady is None:
        middle = 0.5 * float(time[0] + time[-1])
        return window(time, middle, 0.05 * float(time[-1] - time[0]))
    turn_s = 2.0 * math.pi / max(abs(steady.velocity_rad_s), 1e-9)
    middle = 0.5 * (steady.from_s + steady.to_s)
    return window(time, middle, min(_ZOOM_TURNS * turn_s, steady.to_s - middle))


def _limits(axes: Axes, torque: FloatArray, filtered: FloatArray) -> None:
    """Hold all of the measured torque and 98 % of the filtered: its start may leave the frame."""
    present = torque[np.isfinite(torque)]
    settled = filtered[np.isfinite(filtered)]
    if len(settled):
        present = np.concatenate([present, np.percentile(settled, [1.0, 99.0])])
    if len(present):
        low, high = float(present.min()), float(present.max())
        margin = 0.1 * (high - low) or 1.0
        axes.set_ylim(low - margin, high + margin)


def _spread(signals: Signals, torque: FloatArray, steady: Steady | None) -> float:
    cut: Any = slice(None)
    if steady is not None:
        cut = window(signals.time_s, steady.from_s, steady.to_s - steady.from_s)
    present = torque[cut]
    return float(np.nanstd(present)) if np.isfinite(present).any() else 0.0


def signature_picture(signals: Signals, result: Mapping[str, Any], name: str) -> Picture | None:
    """Draw the misalignment signature: measured, expected, and the component found."""
    motion = signals.motion
    if motion is None or signals.expected_nm is None or "amplitude_nm" not in result:
        return None
    figure, (axes,) = new_figure(1, 3.4)
    time = signals.time_s
    trend(axes, time, signals.torque_nm, "measured", width=0.6, label="measured")
    trend(axes, time, signals.expected_nm, "expected", label="expected")
    found = _component(signals, motion.output_angle_rad, result)
    trend(axes, time, found, "filtered", width=1.8, label="once per output turn")
    label_axes(axes, "time (s)", "torque (N·m)")
    legend_above(axes)
    peak = float(result["peak_to_peak_nm"]["value"])
    caption = (
        f"At constant velocity the expected torque is flat, but the measured one swings once per "
        f"turn of the output: {peak:.3f} N·m from peak to peak. That swing is the signature of a "
        "shaft and a load that do not share one axis. In CIM-TR-97-06 a careful re-assembly "
        "brought it from 10 to below 2 N·m."
    )
    alt = (
        f"Measured torque over time with a slow sinusoid of {peak:.3f} newton metres peak to peak, "
        "against a flat expected torque."
    )
    title = "Misalignment signature (after figure 10)"
    return Picture(title, caption, alt, draw_svg(figure, name, alt))


def _component(
    signals: Signals, output_angle_rad: FloatArray, result: Mapping[str, Any]
) -> FloatArray:
    amplitude, phase = float(result["amplitude_nm"]["value"]), float(result["phase_rad"]["value"])
    found = np.full(len(signals.time_s), np.nan)
    for stretch in result.get("stretches", ()):
        cut = window(signals.time_s, stretch["from_s"], stretch["to_s"] - stretch["from_s"])
        offset = stretch.get("offset_nm", {"value": 0.0})["value"]
        found[cut] = offset + amplitude * np.cos(output_angle_rad[cut] + phase)
    return found
