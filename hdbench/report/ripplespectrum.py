"""Figure of the ripple: power over order, with its peaks named."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hdbench.estimation.spectrum import Spectrum, amplitude_spectrum
from hdbench.estimation.stretches import SteadyStretch
from hdbench.report.canvas import COLOURS, Panel, min_max, new_figure
from hdbench.report.numbers import short
from hdbench.report.pagemodel import Picture
from hdbench.report.signals import Signals

# peaks named in a spectrum: more of them are noise to the eye; the result holds all
_MOST_PEAKS = 6
# labels closer than this share of the abscissa would cover each other
_LABEL_SHARE = 0.14


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
