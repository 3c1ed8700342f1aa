"""Misalignment in a report: verdict, summary, key numbers, figures, tables."""

from __future__ import annotations

import numpy as np

from hdbench.report.canvas import new_figure
from hdbench.report.numbers import with_std
from hdbench.report.pagemodel import KeyNumber, Picture, Table, Verdict
from hdbench.report.ripple import extra_line_tables, with_extra_lines
from hdbench.report.signals import Signals, filter_picture, make_signals, steady_stretch
from hdbench.report.source import Source
from hdbench.results import MisalignmentResult

# what the report calls well assembled, section 5: "reduced from 10 N.m to less than 2 N.m"
_WELL_ASSEMBLED_NM = 2.0


def verdict(result: MisalignmentResult) -> Verdict:
    """Say how large the misalignment is."""
    peak = result.peak_to_peak_nm
    words = f"{with_std(peak)} N·m from peak to peak"
    if result.small_amplitude:
        found = Verdict("good", f"No misalignment above the noise: {words}.")
    elif peak.value < _WELL_ASSEMBLED_NM:
        found = Verdict("good", f"Misalignment {words}, below the 2 N·m of a careful assembly.")
    else:
        found = Verdict("look", f"Misalignment {words}, above the 2 N·m of a careful assembly.")
    return with_extra_lines(found, result)


def numbers(result: MisalignmentResult, run_id: str) -> tuple[KeyNumber, ...]:
    """Return amplitude, phase and what the filter leaves."""
    before, after = result.before.peak_to_peak_nm, result.after.peak_to_peak_nm
    rows = (
        (result.peak_to_peak_nm, "misalignment, peak to peak", "peak_to_peak_nm", "N m"),
        (result.amplitude_nm, "misalignment, amplitude", "amplitude_nm", "N m"),
        (result.phase_rad, "misalignment, phase", "phase_rad", "rad"),
        (before, "peak to peak before the filter", "before.peak_to_peak_nm", "N m"),
        (after, "peak to peak after the filter", "after.peak_to_peak_nm", "N m"),
        (result.motor_velocity_rad_s, "motor velocity", "motor_velocity_rad_s", "rad/s"),
        (result.output_turns, "output turns", "output_turns", ""),
        (result.mean_torque_nm, "mean torque", "mean_torque_nm", "N m"),
    )
    return KeyNumber.rows(rows, run_id)


def pictures(source: Source, prefix: str, doubts: list[str]) -> tuple[Picture, ...]:
    """Draw the signature and what the filter makes of it."""
    signals = make_signals(source, doubts)
    if signals is None:
        return ()
    drawn = [_signature(signals, source.result, f"{prefix}-signature")]
    if signals.own is not None and source.profile is not None:
        steady = steady_stretch(signals, source.profile.data.ripple.steady_tolerance)
        name = f"{prefix}-filter"
        drawn.append(filter_picture(signals, signals.own, None, steady, name, figure_number="11"))
    return tuple(picture for picture in drawn if picture is not None)


def _signature(signals: Signals, result: MisalignmentResult | None, name: str) -> Picture | None:
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
    return Picture.drawn(figure, name, "signature", peak=result.peak_to_peak_nm.value)


def tables(result: MisalignmentResult) -> tuple[Table, ...]:
    """List the stretches and the ripple fitted beside."""
    stretches = Table.told("stretches", result.stretches)
    ripple = Table.told("fitted_ripple", result.ripple)
    return (*Table.filled(stretches, ripple), *extra_line_tables(result))
