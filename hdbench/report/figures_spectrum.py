"""Torque, velocity and the power spectrum of a steady stretch."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hdbench.estimation import Spectrum, amplitude_spectrum
from hdbench.report.canvas import COLOURS, draw_svg, label_axes, new_figure, trend
from hdbench.report.decimate import min_max
from hdbench.report.elements import Picture
from hdbench.report.numbers import short
from hdbench.report.signals import Signals, window
from hdbench.report.steady import Steady

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["ripple_picture"]

# peaks named in a spectrum: more of them are noise to the eye; the result holds all
_MOST_PEAKS = 6
# labels closer than this share of the abscissa would cover each other
_LABEL_SHARE = 0.14


def _spectrum(signals: Signals, steady: Steady) -> Spectrum:
    part = window(signals.time_s, steady.from_s, steady.to_s - steady.from_s)
    time, torque = signals.time_s[part], signals.torque_nm[part]
    return amplitude_spectrum(torque, float(np.median(np.diff(time))))


def ripple_picture(
    signals: Signals, steady: Steady, peaks: Sequence[Mapping[str, Any]], name: str
) -> Picture:
    """Draw torque, velocity and the power spectrum of the steady stretch."""
    spectrum = _spectrum(signals, steady)
    figure, (torque, velocity, power) = new_figure(3, 6.2, ratios=(1.0, 0.75, 1.35))
    velocity.sharex(torque)
    trend(torque, signals.time_s, signals.torque_nm, "measured", width=0.8)
    trend(velocity, signals.time_s, signals.velocity_rad_s, "filtered")
    for axes in (torque, velocity):
        axes.axvspan(steady.from_s, steady.to_s, color=COLOURS["expected"], alpha=0.16, linewidth=0)
    label_axes(torque, None, "torque (N·m)", "measured torque; shaded: the steady stretch")
    label_axes(velocity, "time (s)", "motor (rad/s)", "motor velocity")
    _power(power, spectrum, abs(steady.velocity_rad_s))
    named = _name_peaks(power, spectrum, steady, peaks)
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
    return Picture(title, caption, alt, draw_svg(figure, name, alt))


def _decibel(power: Any) -> Any:
    # the least power that has a logarithm: an empty bin is drawn far below the floor
    return 10.0 * np.log10(np.maximum(power, 1e-300))


def _power(axes: Axes, spectrum: Spectrum, speed_rad_s: float) -> None:
    omega = 2.0 * math.pi * spectrum.frequency_hz
    show = (omega > 0.2 * speed_rad_s) & (omega <= max(6.5 * speed_rad_s, 10.0))
    x, y = min_max(omega[show], _decibel(spectrum.power_density[show]))
    axes.plot(x, y, color=COLOURS["measured"], linewidth=0.9)
    if len(y):
        axes.set_ylim(float(np.percentile(y, 5)) - 6.0, float(np.max(y)) + 16.0)
    title = "power spectrum of the steady stretch"
    label_axes(axes, "angular frequency (rad/s)", "power (dB re 1 (N·m)²/Hz)", title)


def _name_peaks(
    axes: Axes, spectrum: Spectrum, steady: Steady, peaks: Sequence[Mapping[str, Any]]
) -> str:
    speed, right = abs(steady.velocity_rad_s), axes.get_xlim()[1]
    words: list[str] = []
    labelled: list[float] = []
    for peak in peaks[:_MOST_PEAKS]:
        omega = float(peak["angular_frequency_rad_s"])
        if not 0.2 * speed < omega < right:
            continue
        at = int(np.argmin(np.abs(2.0 * math.pi * spectrum.frequency_hz - omega)))
        level = float(_decibel(spectrum.power_density[at]))
        order = omega / speed
        label = str(peak.get("name") or f"order {order:.3g}")
        axes.plot([omega], [level], marker="v", markersize=5, color=COLOURS["expected"], zorder=4)
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
    if not words:
        return "No peak stands out of the noise."
    return "Peaks: " + ", ".join(words) + "."
