"""The misalignment section of a report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.report.extralines import extra_line_tables, with_extra_lines
from hdbench.report.numbers import short, value_of, with_std
from hdbench.report.pagemodel import (
    KeyNumber,
    Picture,
    Table,
    Verdict,
    filled,
    key_numbers,
    make_table,
)
from hdbench.report.source import Source

__all__ = ["numbers", "pictures", "summary", "tables", "verdict"]

# what the report calls well assembled, section 5: "reduced from 10 N.m to less than 2 N.m"
_WELL_ASSEMBLED_NM = 2.0


def verdict(result: Mapping[str, Any]) -> Verdict:
    """Say how large the misalignment is."""
    peak = result["peak_to_peak_nm"]
    words = f"{with_std(peak)} N·m from peak to peak"
    if result.get("small_amplitude"):
        found = Verdict("good", f"No misalignment above the noise: {words}.")
    elif float(peak["value"]) < _WELL_ASSEMBLED_NM:
        found = Verdict("good", f"Misalignment {words}, below the 2 N·m of a careful assembly.")
    else:
        found = Verdict("look", f"Misalignment {words}, above the 2 N·m of a careful assembly.")
    return with_extra_lines(found, result)


def summary(result: Mapping[str, Any], _source: Source) -> str:
    """Say in plain words what the run found."""
    speed, turns = value_of(result, "motor_velocity_rad_s"), value_of(result, "output_turns")
    before = value_of(result, "before", "peak_to_peak_nm")
    after = value_of(result, "after", "peak_to_peak_nm")
    motion = ""
    if speed is not None and turns is not None:
        motion = f"at {speed:.1f} rad/s over {turns:.2f} output turns "
    text = (
        f"The motor turned {motion}and the torque swung once per turn of the output by "
        f"{with_std(result['peak_to_peak_nm'])} N·m from peak to peak. "
    )
    if before and after is not None:
        text += (
            f"After the filter {short(after, 0.01 * before)} N·m of the {short(before)} N·m are "
            f"left ({100.0 * after / before:.1f} %). "
        )
    mean = value_of(result, "mean_torque_nm")
    if mean is not None:
        text += f"The mean torque was {short(mean, 0.01)} N·m."
    return text


def numbers(result: Mapping[str, Any], run_id: str) -> tuple[KeyNumber, ...]:
    """Return amplitude, phase and what the filter leaves."""
    before, after = (result.get(key, {}).get("peak_to_peak_nm") for key in ("before", "after"))
    rows = (
        (result.get("peak_to_peak_nm"), "misalignment, peak to peak", "peak_to_peak_nm", "N m"),
        (result.get("amplitude_nm"), "misalignment, amplitude", "amplitude_nm", "N m"),
        (result.get("phase_rad"), "misalignment, phase", "phase_rad", "rad"),
        (before, "peak to peak before the filter", "before.peak_to_peak_nm", "N m"),
        (after, "peak to peak after the filter", "after.peak_to_peak_nm", "N m"),
        (result.get("motor_velocity_rad_s"), "motor velocity", "motor_velocity_rad_s", "rad/s"),
        (result.get("output_turns"), "output turns", "output_turns", ""),
        (result.get("mean_torque_nm"), "mean torque", "mean_torque_nm", "N m"),
    )
    return key_numbers(rows, run_id)


def pictures(source: Source, prefix: str, doubts: list[str]) -> tuple[Picture, ...]:
    """Draw the signature and what the filter makes of it."""
    from hdbench.report.signals import make_signals, steady_stretch
    from hdbench.report.torquefigures import filter_picture, signature_picture

    signals = make_signals(source, doubts)
    if signals is None:
        return ()
    drawn = [signature_picture(signals, source.result, f"{prefix}-signature")]
    if signals.own is not None and source.profile is not None:
        steady = steady_stretch(signals, source.profile.data.ripple.steady_tolerance)
        name = f"{prefix}-filter"
        drawn.append(filter_picture(signals, signals.own, None, steady, name, figure_number="11"))
    return tuple(picture for picture in drawn if picture is not None)


def tables(result: Mapping[str, Any]) -> tuple[Table, ...]:
    """List the stretches and the ripple fitted beside."""
    stretches = make_table(
        "Stretches evaluated",
        (
            ("time (s)", lambda x: f"{float(x['from_s']):.2f} to {float(x['to_s']):.2f}"),
            (
                "motor velocity (rad/s)",
                lambda x: x.get("motor_velocity_rad_s", x.get("velocity_rad_s")),
            ),
            ("output turns", lambda x: x.get("output_turns")),
            ("zero (N·m)", lambda x: x.get("offset_nm")),
        ),
        result.get("stretches", ()),
    )
    ripple = make_table(
        "Ripple fitted at the same time",
        (("motor order", "order"), ("amplitude (N·m)", "amplitude_nm")),
        result.get("ripple", ()),
    )
    return (*filled(stretches, ripple), *extra_line_tables(result))
