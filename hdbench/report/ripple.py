"""Ripple in a report: verdict, key numbers, figures, tables; also of a trace without a result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hdbench.estimation.spectrum import Spectrum, amplitude_spectrum
from hdbench.estimation.stretches import SteadyStretch
from hdbench.report.canvas import COLOURS, Panel, min_max, new_figure
from hdbench.report.numbers import extra_lines, short, with_std
from hdbench.report.pagemodel import KeyNumber, Picture, Table, Verdict
from hdbench.report.signals import Signals, filter_picture, make_signals, steady_stretch
from hdbench.report.source import Source
from hdbench.results import MisalignmentResult, RippleResult
from hdbench.results.dynamic import SteadySpectrum

# peaks named in a spectrum: more of them are noise to the eye; the result holds all
_MOST_PEAKS = 6
# labels closer than this share of the abscissa would cover each other
_LABEL_SHARE = 0.14


def _suppression(result: RippleResult, order: float) -> float | None:
    """Return what the filter takes away at a motor order, dB, or None where it is not known."""
    known = (x.suppression_db for x in result.suppression_db if x.order == order)
    return next((db for db in known if db is not None), None)


def verdict(result: RippleResult) -> Verdict:
    """Say how large the ripple is and how much of it the filter takes."""
    parts, weakest = [], None
    for line in result.ripple:
        order = line.order
        db = _suppression(result, order)
        tail = "" if db is None else f" (filter takes {db:.0f} dB)"
        parts.append(f"{with_std(line.amplitude_nm)} N·m at {order:g}x{tail}")
        weakest = db if weakest is None or (db is not None and db < weakest) else weakest
    words = f"Ripple {', '.join(parts)}." if parts else "No ripple was evaluated."
    # a filter that leaves more than half of a ripple (6 dB) does not do its work
    passed = bool(parts) and (weakest is None or weakest > 6.0)
    return with_extra_lines(Verdict("good" if passed else "look", words), result)


def numbers(result: RippleResult, run_id: str) -> tuple[KeyNumber, ...]:
    """Return amplitudes, phases, suppression and rms."""
    rows: list[tuple[Any, str, str, str]] = []
    for line in result.ripple:
        order = f"{line.order:g}"
        key, name = f"ripple[order={order}]", f"ripple {order}x"
        taken = _suppression(result, line.order)
        rows += [
            (line.amplitude_nm, f"{name}, amplitude", f"{key}.amplitude_nm", "N m"),
            (line.phase_rad, f"{name}, phase", f"{key}.phase_rad", "rad"),
            (taken, f"suppression at {order}x", f"suppression_db[{order}]", "dB"),
        ]
    rms, speed = result.torque_rms_nm, result.motor_velocity_rad_s
    rows += [
        (rms.measured, "torque rms, measured", "torque_rms_nm.measured", "N m"),
        (rms.filtered, "torque rms, filtered", "torque_rms_nm.filtered", "N m"),
        (speed.mean, "motor velocity, mean", "motor_velocity_rad_s.mean", "rad/s"),
    ]
    return KeyNumber.rows(rows, run_id)


def pictures(source: Source, prefix: str, doubts: list[str]) -> tuple[Picture, ...]:
    """Draw torque, velocity, spectrum, and what two filters make of the torque."""
    signals = make_signals(source, doubts)
    if signals is None:
        return ()
    # without a profile: what "almost flat" is on the bench of CIM-TR-97-06
    tolerance = 0.02 if source.profile is None else source.profile.data.ripple.steady_tolerance
    spectrum = source.result and source.result.spectrum
    steady = (spectrum and _stored_stretch(spectrum, signals)) or steady_stretch(signals, tolerance)
    drawn = []
    if steady is None:
        doubts.append("Nothing turns steadily: no power spectrum is drawn.")
    else:
        speed = abs(steady.velocity_rad_s)
        known = [(f"{order}x", order * speed) for order in (2, 4)]
        peaks = [(p.name, p.angular_frequency_rad_s) for p in spectrum.peaks] if spectrum else []
        drawn.append(_spectrum_picture(signals, steady, peaks or known, f"{prefix}-spectrum"))
    cutoff = None if source.profile is None else source.profile.data.filter.butterworth_cutoff_hz
    for filtered, lowpass_hz, part, number in (
        (signals.fourth, cutoff, "fourth", "9"),
        (signals.own, None, "own", "11"),
    ):
        if filtered is not None:
            name = f"{prefix}-{part}"
            drawn.append(
                filter_picture(signals, filtered, lowpass_hz, steady, name, figure_number=number)
            )
    return tuple(drawn)


def _stored_stretch(spectrum: SteadySpectrum, signals: Signals) -> SteadyStretch | None:
    """Return the stretch that the result names, or None where samples are missing in it."""
    part = signals.during(spectrum.from_s, spectrum.to_s)
    inside = signals.torque_nm[part]
    # a spectrum needs samples without a gap, and at least 16 of them
    if len(inside) < 16 or not np.isfinite(inside).all():
        return None
    return SteadyStretch(
        part.start, part.stop, spectrum.from_s, spectrum.to_s, spectrum.motor_velocity_rad_s
    )


def _spectrum_picture(
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
    speed = abs(steady.velocity_rad_s)
    return Picture.drawn(
        figure,
        name,
        "ripple",
        start=steady.from_s,
        end=steady.to_s,
        velocity=short(steady.velocity_rad_s),
        speed=speed,
        peaks=_name_peaks(power, spectrum, speed, peaks),
    )


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


def tables(result: RippleResult) -> tuple[Table, ...]:
    """List the orders, and lines beyond them."""
    ripple = Table.told("ripple", result.ripple, taken=_suppression, result=result)
    return (ripple, *extra_line_tables(result))


def with_extra_lines(verdict: Verdict, result: MisalignmentResult | RippleResult) -> Verdict:
    """Return a verdict that says when more stands out than was looked for."""
    words = extra_lines(result)
    if not words:
        return verdict
    level = "look" if verdict.level == "good" else verdict.level
    return Verdict(level, f"{verdict.text} More stands out ({words}): diagnose this run.")


def extra_line_tables(result: MisalignmentResult | RippleResult) -> tuple[Table, ...]:
    """Return the table of lines and tones; empty where there are none."""
    return Table.filled(Table.told("extra_lines", (*result.lines, *result.tones)))
