"""Figures of a dynamic run: what the filter takes away, and the misalignment signature."""

from __future__ import annotations

import math

import numpy as np

from hdbench.estimation.stretches import SteadyStretch
from hdbench.records import FloatArray
from hdbench.report.canvas import Panel, new_figure
from hdbench.report.pagemodel import Picture
from hdbench.report.signals import Filtered, Signals
from hdbench.results import MisalignmentResult

# turns of the wave generator in a close-up: enough to see orders 2 and 4, few enough to tell them
_ZOOM_TURNS = 4.0


def filter_picture(
    signals: Signals,
    filtered: Filtered,
    lowpass_hz: float | None,
    steady: SteadyStretch | None,
    name: str,
    *,
    figure_number: str,
) -> Picture:
    """Draw measured against filtered torque: the whole run and a close-up."""
    figure, (whole, close) = new_figure(2, 4.8)
    lowpass = None if lowpass_hz is None else signals.lowpass_nm
    for axes, cut in ((whole, slice(None)), (close, _close_up(signals, steady))):
        line, width = (":", 1.1) if axes is close else ("-", 0.7)
        time, torque, smooth = (
            v[cut] for v in (signals.time_s, signals.torque_nm, filtered.torque_nm)
        )
        axes.curve(time, torque, "measured", line, linewidth=width, label="measured")
        if lowpass is not None:
            axes.curve(time, lowpass[cut], "lowpass", "--", label="low-pass")
        axes.curve(time, smooth, "filtered", label="Kalman filtered")
        _limits(axes, torque, smooth)
    whole.label(None, "torque (N·m)")
    whole.legend_above()
    close.label("time (s)", "torque (N·m)", "close-up")
    rms = [_spread(signals, torque, steady) for torque in (signals.torque_nm, filtered.torque_nm)]
    orders = ", ".join(f"{block.order:g}" for block in filtered.model.blocks)
    how = "computed while the run was sampled" if filtered.online else "computed from the trace"
    where = "In the steady stretch" if steady is not None else "Over the whole run"
    caption = (
        f"Measured torque (dotted in the close-up) and what the filter {filtered.model.name} makes "
        f"of it ({how}; motor orders {orders}). {where} the torque scatters by {rms[0]:.3f} N·m "
        f"rms measured and {rms[1]:.3f} N·m rms filtered."
    )
    if lowpass is not None:
        caption += (
            f" The dashed {lowpass_hz:g} Hz Butterworth low-pass also smooths, but lags, and it "
            "cannot tell a slow disturbance from the torque."
        )
    alt = (
        f"Measured torque and the smoother output of the Kalman filter {filtered.model.name} over "
        f"time; scatter falls from {rms[0]:.3f} to {rms[1]:.3f} newton metres."
    )
    title = f"Measured against filtered: {filtered.model.name} (after figure {figure_number})"
    return Picture.drawn(figure, name, title, caption, alt)


def _close_up(signals: Signals, steady: SteadyStretch | None) -> slice:
    if steady is None:
        first, last = float(signals.time_s[0]), float(signals.time_s[-1])
        middle = 0.5 * (first + last)
        return signals.during(middle, middle + 0.05 * (last - first))
    turn_s = 2.0 * math.pi / max(abs(steady.velocity_rad_s), 1e-9)
    middle = 0.5 * (steady.from_s + steady.to_s)
    return signals.during(middle, min(middle + _ZOOM_TURNS * turn_s, steady.to_s))


def _limits(axes: Panel, torque: FloatArray, filtered: FloatArray) -> None:
    """Hold all of the measured torque and 98 % of the filtered: its start may leave the frame."""
    present, settled = torque[np.isfinite(torque)], filtered[np.isfinite(filtered)]
    if len(settled):
        present = np.concatenate([present, np.percentile(settled, [1.0, 99.0])])
    if len(present):
        low, high = float(present.min()), float(present.max())
        margin = 0.1 * (high - low) or 1.0
        axes.set_ylim(low - margin, high + margin)


def _spread(signals: Signals, torque: FloatArray, steady: SteadyStretch | None) -> float:
    part = torque if steady is None else torque[signals.during(steady.from_s, steady.to_s)]
    return float(np.nanstd(part)) if np.isfinite(part).any() else 0.0


def signature_picture(
    signals: Signals, result: MisalignmentResult | None, name: str
) -> Picture | None:
    """Draw the misalignment signature: measured, expected, and the component found."""
    if signals.motion is None or signals.expected_nm is None or result is None:
        return None
    figure, (axes,) = new_figure(1, 3.4)
    time, angle = signals.time_s, signals.motion.output_angle_rad
    amplitude, phase = result.amplitude_nm.value, result.phase_rad.value
    found = np.full(len(time), np.nan)
    for stretch in result.stretches:
        cut = signals.during(stretch.from_s, stretch.to_s)
        found[cut] = stretch.offset_nm.value + amplitude * np.cos(angle[cut] + phase)
    axes.curve(time, signals.torque_nm, "measured", linewidth=0.6, label="measured")
    axes.curve(time, signals.expected_nm, "expected", label="expected")
    axes.curve(time, found, "filtered", linewidth=1.8, label="once per output turn")
    axes.label("time (s)", "torque (N·m)")
    axes.legend_above()
    peak = result.peak_to_peak_nm.value
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
    return Picture.drawn(figure, name, title, caption, alt)
