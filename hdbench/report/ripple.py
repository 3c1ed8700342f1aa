"""The ripple section of a report, and that of a trace without a result."""

from __future__ import annotations

from typing import Any

import numpy as np

from hdbench.estimation.stretches import SteadyStretch
from hdbench.report.extralines import extra_line_tables, extra_line_words, with_extra_lines
from hdbench.report.numbers import short, with_std
from hdbench.report.pagemodel import KeyNumber, Picture, Table, Verdict
from hdbench.report.signals import Signals, make_signals, steady_stretch
from hdbench.report.source import Source
from hdbench.results import RippleResult
from hdbench.results.dynamic import SteadySpectrum


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


def summary(result: RippleResult, _source: Source) -> str:
    """Say in plain words what the run found."""
    speed, rms = result.motor_velocity_rad_s, result.torque_rms_nm
    text = (
        f"In free motion at motor speeds from {short(speed.min, 0.1)} to {short(speed.max, 0.1)} "
        "rad/s "
    )
    parts = [
        f"{with_std(line.amplitude_nm)} N·m at {line.order:g} times motor speed"
        for line in result.ripple
    ]
    text += "the torque ripples by " + " and ".join(parts) + ". " if parts else "nothing ripples. "
    if rms.measured is not None and rms.filtered is not None:
        text += (
            f"The filter brings the torque from {rms.measured:.3f} to {rms.filtered:.3f} N·m rms. "
        )
    others = extra_line_words(result)
    if others:
        text += f"Beyond the two known orders stand out: {others}. "
    return text


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
    from hdbench.report.runfigures import filter_picture, ripple_picture

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
        drawn.append(ripple_picture(signals, steady, peaks or known, f"{prefix}-spectrum"))
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


def tables(result: RippleResult) -> tuple[Table, ...]:
    """List the orders, and lines beyond them."""
    ripple = Table.of(
        "Ripple",
        (
            ("motor order", "order"),
            ("amplitude (N·m)", "amplitude_nm"),
            ("phase (rad)", "phase_rad"),
            ("suppression (dB)", lambda line: _suppression(result, line.order)),
        ),
        result.ripple,
    )
    return (ripple, *extra_line_tables(result))
