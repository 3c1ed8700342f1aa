"""How the calibration was run: environment, sequence, shunt, and what departs from a standard's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hdbench.calibration.metrology import Metrology
from hdbench.calibration.readings import TakenReading
from hdbench.profile.calibrating import ShuntCheck
from hdbench.records.loads import SequenceEntry

__all__ = ["course_dict", "sequence_deviations", "shunt_dict"]

# in the manner of EURAMET cg-14: positions, steps for the coarsest classes, share of the largest
# torque at which the steps begin, time from the change of load to the reading in s
_POSITIONS, _STEPS, _FIRST_STEP, _WAIT_S = 3, 3, 0.2, 30.0
# a first step written as 20 % may be 20.4 % by the weights at hand
_FIRST_STEP_SLACK = 0.055


def course_dict(
    readings: Sequence[TakenReading], sequence: Sequence[SequenceEntry]
) -> dict[str, Any]:
    """Return environment and times of the readings."""
    return {
        "temperature_c": _ends([t.reading.temperature_c for t in readings]),
        "humidity_percent": _ends([t.detail.humidity_percent for t in readings]),
        "pressure_hpa": _ends([t.detail.pressure_hpa for t in readings]),
        "time_s": _ends([t.reading.time_s for t in readings]),
        "n_preloads": sum(t.detail.kind == "preload" for t in readings)
        + sum(entry.kind == "preload" and bool(entry.torque_nm) for entry in sequence),
        "n_excluded_samples": sum(t.detail.n_excluded for t in readings),
        "excluded_at_s": [time for t in readings for time in t.detail.excluded_at_s],
    }


def _ends(values: Sequence[float | None]) -> dict[str, float] | None:
    known = [v for v in values if v is not None]
    if not known:
        return None
    return {"first": known[0], "last": known[-1], "least": min(known), "largest": max(known)}


def sequence_deviations(found: Metrology, n_preloads: int) -> list[str]:
    """Return what departs from the sequence of the guide, in words."""
    out: list[str] = []
    for group in found.groups:
        name = f"{group.group.direction}, {group.group.range} range"
        quantities, torque = group.found, group.group.torque_nm
        if quantities.n_positions < _POSITIONS:
            out.append(
                f"{name}: positions: {quantities.n_positions}; the guide has at least {_POSITIONS}"
            )
        if len(torque) < _STEPS:
            out.append(f"{name}: steps: {len(torque)}; the guide has at least {_STEPS}")
        first = float(torque[0] / torque[-1])
        if first > _FIRST_STEP + _FIRST_STEP_SLACK:
            out.append(f"{name}: first step at {100.0 * first:.0f} %; the guide begins at 20 %")
        if quantities.repeatability_v is None:
            out.append(f"{name}: no repeated series in one mounting, so no repeatability b'")
        if group.two is None:
            out.append(f"{name}: no decreasing torque, so no reversibility h")
        if quantities.zero_v is None:
            out.append(f"{name}: no zero before and after a series, so no f0")
        if any(series.zero_by_line for series in group.group.series):
            out.append(f"{name}: no zero reading; the intercept of the line stands for it")
    if not n_preloads:
        out.append("no preloads are told of; the guide has three before the first series")
    return out


def shunt_dict(
    readings: Sequence[TakenReading],
    sequence: Sequence[SequenceEntry],
    shunt: ShuntCheck | None,
    gain_nm_per_v: float,
) -> dict[str, Any] | None:
    """Return the shunt readings, and whether they are those of the last calibration."""
    volts = [t.reading.reading_v for t in readings if t.detail.kind == "shunt"]
    volts += [e.reading_v for e in sequence if e.kind == "shunt" and e.reading_v is not None]
    if not volts and shunt is None:
        return None
    mean = sum(volts) / len(volts) if volts else None
    expected = None if shunt is None else shunt.expected_v
    change = mean / expected - 1.0 if mean is not None and expected else None
    limit = None if shunt is None else shunt.tolerance
    return {
        "resistor_ohm": None if shunt is None else shunt.resistor_ohm,
        "reading_v": mean,
        "n": len(volts),
        "expected_v": expected,
        "change": change,
        "tolerance": limit,
        "within": None if change is None or limit is None else abs(change) <= limit,
        "torque_equivalent_nm": None if mean is None else gain_nm_per_v * mean,
    }
