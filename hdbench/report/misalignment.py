"""Misalignment in a report: verdict, summary, key numbers, figures, tables."""

from __future__ import annotations

from hdbench.report.extralines import extra_line_tables, with_extra_lines
from hdbench.report.numbers import short, with_std
from hdbench.report.pagemodel import KeyNumber, Picture, Table, Verdict
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


def summary(result: MisalignmentResult, _source: Source) -> str:
    """Say in plain words what the run found."""
    before, after = result.before.peak_to_peak_nm.value, result.after.peak_to_peak_nm.value
    return (
        f"The motor turned at {result.motor_velocity_rad_s:.1f} rad/s over "
        f"{result.output_turns:.2f} output turns and the torque swung once per turn of the output "
        f"by {with_std(result.peak_to_peak_nm)} N·m from peak to peak. After the filter "
        f"{short(after, 0.01 * before)} N·m of the {short(before)} N·m are left "
        f"({100.0 * after / before:.1f} %). The mean torque was "
        f"{short(result.mean_torque_nm, 0.01)} N·m."
    )


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
    from hdbench.report.runfigures import filter_picture, signature_picture
    from hdbench.report.signals import make_signals, steady_stretch

    signals = make_signals(source, doubts)
    if signals is None:
        return ()
    drawn = [signature_picture(signals, source.result, f"{prefix}-signature")]
    if signals.own is not None and source.profile is not None:
        steady = steady_stretch(signals, source.profile.data.ripple.steady_tolerance)
        name = f"{prefix}-filter"
        drawn.append(filter_picture(signals, signals.own, None, steady, name, figure_number="11"))
    return tuple(picture for picture in drawn if picture is not None)


def tables(result: MisalignmentResult) -> tuple[Table, ...]:
    """List the stretches and the ripple fitted beside."""
    stretches = Table.of(
        "Stretches evaluated",
        (
            ("time (s)", lambda stretch: f"{stretch.from_s:.2f} to {stretch.to_s:.2f}"),
            ("motor velocity (rad/s)", "motor_velocity_rad_s"),
            ("zero (N·m)", "offset_nm"),
        ),
        result.stretches,
    )
    ripple = Table.of(
        "Ripple fitted at the same time",
        (("motor order", "order"), ("amplitude (N·m)", "amplitude_nm")),
        result.ripple,
    )
    return (*Table.filled(stretches, ripple), *extra_line_tables(result))
