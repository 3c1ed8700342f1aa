"""Figures of a run with motion: filtered torque, misalignment signature, ripple spectrum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hdbench.estimation.spectrum import Spectrum, amplitude_spectrum
from hdbench.estimation.stretches import SteadyStretch
from hdbench.records import FloatArray
from hdbench.report.canvas import COLOURS, Panel, min_max, new_figure
from hdbench.report.numbers import short
from hdbench.report.pagemodel import Picture
from hdbench.report.signals import Filtered, Signals
from hdbench.results import MisalignmentResult

# turns of the wave generator in a close-up: enough to see orders 2 and 4, few enough to tell them
_ZOOM_TURNS = 4.0
# peaks named in a spectrum: more of them are noise to the eye; the result holds all
_MOST_PEAKS = 6
# labels closer than this share of the abscissa would cover each other
_LABEL_SHARE = 0.14


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


def ripple_picture(
    signals: Signals, steady: SteadyStretch, peaks: Sequence[tuple[str | None, float]], name: str
) -> Picture:
    """Draw torque, velocity and the power spectrum of the steady stretch."""
    part = signals.during(steady.from_s, steady.to_s)
    step = float(np.median(np.diff(signals.time_s[part])))
    spectrum = amplitude_spectrum(signals.torque_nm[part], step)
    figure, (torque, velocity, power) = new_figure(3, 6.2, ratios=(1.0, 0.75, 1.35))
    velocity.sharex(torque)
    torque.curve(signals.time_s, signals.torque_nm, "measured", linewidth=0.8)
    velocity.curve(signals.time_s, signals.velocity_rad_s, "filtered")
    for axes in (torque, velocity):
        axes.axvspan(steady.from_s, steady.to_s, color=COLOURS["expected"], alpha=0.16, linewidth=0)
    torque.label(None, "torque (N·m)", "measured torque; shaded: the steady stretch")
    velocity.label("time (s)", "motor (rad/s)", "motor velocity")
    _power(power, spectrum, abs(steady.velocity_rad_s))
    named = _name_peaks(power, spectrum, abs(steady.velocity_rad_s), peaks)
    caption = (
        f"Torque and velocity of the whole run, and the power spectrum of the torque from "
        f"{steady.from_s:.2f} s to {steady.to_s:.2f} s, where the motor turns at "
        f"{short(steady.velocity_rad_s)} rad/s. {named} CIM-TR-97-06 sees the same at 156 rad/s: "
        "peaks at 312 and 624 rad/s."
    )
    alt = (
        "Three charts: torque over time, motor velocity over time, and power spectrum with peaks "
        "near two and four times the motor velocity of "
        f"{abs(steady.velocity_rad_s):.1f} radians per second."
    )
    title = "Torque, velocity and power spectrum (after figure 8)"
    return Picture.drawn(figure, name, title, caption, alt)


def _decibel(power: Any) -> Any:
    # the least power that has a logarithm: an empty bin is drawn far below the floor
    return 10.0 * np.log10(np.maximum(power, 1e-300))


def _power(axes: Panel, spectrum: Spectrum, speed_rad_s: float) -> None:
    omega = 2.0 * math.pi * spectrum.frequency_hz
    show = (omega > 0.2 * speed_rad_s) & (omega <= max(6.5 * speed_rad_s, 10.0))
    x, y = min_max(omega[show], _decibel(spectrum.power_density[show]))
    axes.curve(x, y, "measured", linewidth=0.9)
    if len(y):
        axes.set_ylim(float(np.percentile(y, 5)) - 6.0, float(np.max(y)) + 16.0)
    title = "power spectrum of the steady stretch"
    axes.label("angular frequency (rad/s)", "power (dB re 1 (N·m)²/Hz)", title)


def _name_peaks(
    axes: Panel, spectrum: Spectrum, speed_rad_s: float, peaks: Sequence[tuple[str | None, float]]
) -> str:
    right, words = axes.get_xlim()[1], []
    labelled: list[float] = []
    for name, omega in peaks[:_MOST_PEAKS]:
        if not 0.2 * speed_rad_s < omega < right:
            continue
        at = int(np.argmin(np.abs(2.0 * math.pi * spectrum.frequency_hz - omega)))
        level = float(_decibel(spectrum.power_density[at]))
        order = omega / speed_rad_s
        label = name or f"order {order:.3g}"
        axes.curve([omega], [level], "expected", "v", markersize=5, zorder=4)
        words.append(f"{label} at {omega:.0f} rad/s ({order:.3f} times the velocity)")
        if all(abs(omega - other) > _LABEL_SHARE * right for other in labelled):
            labelled.append(omega)
            axes.annotate(
                f"{label}: {omega:.0f}",
                (omega, level),
                xytext=(0, 6),
                textcoords="offset points",
                ha="center",
                color=COLOURS["ink"],
            )
    return f"Peaks: {', '.join(words)}." if words else "No peak stands out of the noise."
