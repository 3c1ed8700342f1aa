"""The ripple section of a report, and that of a trace without a result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hdbench.report.beyond import beyond_tables, beyond_words, with_beyond
from hdbench.report.elements import KeyNumber, Picture, Table, Verdict
from hdbench.report.keynumbers import key_numbers, value_of
from hdbench.report.numbers import plain, short, with_std
from hdbench.report.signals import Signals, make_signals, window
from hdbench.report.source import Source
from hdbench.report.steady import Steady, steady_stretch

__all__ = ["numbers", "pictures", "summary", "suppression_at", "tables", "verdict"]


def suppression_at(result: Mapping[str, Any], order: float) -> float | None:
    """Return what the filter takes away at a motor order, dB, or None where it is not known."""
    for entry in result.get("suppression_db", ()):
        if float(entry["order"]) == order and entry["suppression_db"] is not None:
            return float(entry["suppression_db"])
    return None


def verdict(result: Mapping[str, Any]) -> Verdict:
    """Say how large the ripple is and how much of it the filter takes."""
    parts, weakest = [], None
    for line in result.get("ripple", ()):
        order = float(line["order"])
        db = suppression_at(result, order)
        tail = "" if db is None else f" (filter takes {db:.0f} dB)"
        parts.append(f"{with_std(line['amplitude_nm'])} N·m at {order:g}x{tail}")
        weakest = db if weakest is None or (db is not None and db < weakest) else weakest
    words = f"Ripple {', '.join(parts)}." if parts else "No ripple was evaluated."
    # a filter that leaves more than half of a ripple (6 dB) does not do its work
    passed = bool(parts) and (weakest is None or weakest > 6.0)
    return with_beyond(Verdict("good" if passed else "look", words), result)


def summary(result: Mapping[str, Any], _source: Source) -> str:
    """Say in plain words what the run found."""
    speed = result.get("motor_velocity_rad_s", {})
    text = "In free motion "
    if isinstance(speed, Mapping) and "mean" in speed:
        text += (
            f"at motor speeds from {short(float(speed['min']), 0.1)} to "
            f"{short(float(speed['max']), 0.1)} rad/s "
        )
    parts = [
        f"{with_std(line['amplitude_nm'])} N·m at {float(line['order']):g} times motor speed"
        for line in result.get("ripple", ())
    ]
    text += "the torque ripples by " + " and ".join(parts) + ". " if parts else "nothing ripples. "
    measured = value_of(result, "torque_rms_nm", "measured")
    filtered = value_of(result, "torque_rms_nm", "filtered")
    if measured is not None and filtered is not None:
        text += f"The filter brings the torque from {measured:.3f} to {filtered:.3f} N·m rms. "
    others = beyond_words(result)
    if others:
        text += f"Beyond the two known orders stand out: {'; '.join(others)}. "
    return text


def numbers(result: Mapping[str, Any], run_id: str) -> tuple[KeyNumber, ...]:
    """Return amplitudes, phases, suppression and rms."""
    rows: list[tuple[Any, str, str, str]] = []
    for line in result.get("ripple", ()):
        order = f"{float(line['order']):g}"
        rows += [
            (
                line["amplitude_nm"],
                f"ripple {order}x, amplitude",
                f"ripple[order={order}].amplitude_nm",
                "N m",
            ),
            (
                line["phase_rad"],
                f"ripple {order}x, phase",
                f"ripple[order={order}].phase_rad",
                "rad",
            ),
            (
                suppression_at(result, float(line["order"])),
                f"suppression at {order}x",
                f"suppression_db[{order}]",
                "dB",
            ),
        ]
    rms, speed = result.get("torque_rms_nm", {}), result.get("motor_velocity_rad_s", {})
    rows += [
        (rms.get("measured"), "torque rms, measured", "torque_rms_nm.measured", "N m"),
        (rms.get("filtered"), "torque rms, filtered", "torque_rms_nm.filtered", "N m"),
        (speed.get("mean"), "motor velocity, mean", "motor_velocity_rad_s.mean", "rad/s"),
    ]
    return key_numbers(rows, run_id)


def pictures(source: Source, prefix: str, doubts: list[str]) -> tuple[Picture, ...]:
    """Draw torque, velocity, spectrum, and what two filters make of the torque."""
    from hdbench.report.figures_filter import filter_picture
    from hdbench.report.figures_spectrum import ripple_picture

    signals = make_signals(source, doubts)
    if signals is None:
        return ()
    # without a profile: what "almost flat" is on the bench of CIM-TR-97-06
    tolerance = 0.02 if source.profile is None else source.profile.data.ripple.steady_tolerance
    spectrum = source.result.get("spectrum")
    body = spectrum if isinstance(spectrum, Mapping) else {}
    steady = _stored_stretch(body, signals) or steady_stretch(signals, tolerance)
    drawn = []
    if steady is None:
        doubts.append("Nothing turns steadily: no power spectrum is drawn.")
    else:
        peaks = body.get("peaks") or _known_orders(steady.velocity_rad_s)
        drawn.append(ripple_picture(signals, steady, peaks, f"{prefix}-spectrum"))
    cutoff = None if source.profile is None else source.profile.data.filter.butterworth_cutoff_hz
    if signals.fourth is not None:
        drawn.append(
            filter_picture(
                signals, signals.fourth, cutoff, steady, f"{prefix}-fourth", figure_number="9"
            )
        )
    if signals.own is not None:
        drawn.append(
            filter_picture(signals, signals.own, None, steady, f"{prefix}-own", figure_number="11")
        )
    return tuple(drawn)


def _stored_stretch(body: Mapping[str, Any], signals: Signals) -> Steady | None:
    """Return the stretch that the result names, or None where samples are missing in it."""
    if not {"from_s", "to_s", "motor_velocity_rad_s"} <= body.keys():
        return None
    steady = Steady(float(body["from_s"]), float(body["to_s"]), float(body["motor_velocity_rad_s"]))
    inside = signals.torque_nm[window(signals.time_s, steady.from_s, steady.to_s - steady.from_s)]
    # a spectrum needs samples without a gap, and at least 16 of them
    return steady if len(inside) >= 16 and np.isfinite(inside).all() else None


def _known_orders(velocity_rad_s: float) -> list[dict[str, Any]]:
    speed = abs(velocity_rad_s)
    return [
        {"name": f"{order:g}x", "angular_frequency_rad_s": order * speed} for order in (2.0, 4.0)
    ]


def tables(result: Mapping[str, Any]) -> tuple[Table, ...]:
    """List the orders, and lines beyond them."""
    rows = tuple(
        (
            plain(float(line["order"])),
            plain(line["amplitude_nm"]),
            plain(line["phase_rad"]),
            plain(suppression_at(result, float(line["order"]))),
        )
        for line in result.get("ripple", ())
    )
    head = ("motor order", "amplitude (N·m)", "phase (rad)", "suppression (dB)")
    return (Table("Ripple", head, rows), *beyond_tables(result))
