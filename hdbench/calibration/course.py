"""Course of a calibration: environment, shunt, and what departs from a standard's sequence."""

from __future__ import annotations

from collections.abc import Sequence

from hdbench.calibration.readings import TakenReading
from hdbench.profile.calibrating import ShuntCheck
from hdbench.records.loads import SequenceEntry
from hdbench.results.calibration import Course, Ends, LoadGroup, LoadStep, ShuntRecord

__all__ = ["course_of", "sequence_deviations", "shunt_record"]

# in the manner of EURAMET cg-14: positions, steps for the coarsest classes, share of the largest
# torque at which the steps begin, time from the change of load to the reading in s
_POSITIONS, _STEPS, _FIRST_STEP, _WAIT_S = 3, 3, 0.2, 30.0
# a first step written as 20 % may be 20.4 % by the weights at hand
_FIRST_STEP_SLACK = 0.055


def course_of(readings: Sequence[TakenReading], sequence: Sequence[SequenceEntry]) -> Course:
    """Return environment and times of the readings."""
    return Course(
        temperature_c=_ends([t.reading.temperature_c for t in readings]),
        humidity_percent=_ends([t.detail.humidity_percent for t in readings]),
        pressure_hpa=_ends([t.detail.pressure_hpa for t in readings]),
        time_s=_ends([t.reading.time_s for t in readings]),
        n_preloads=sum(t.detail.kind == "preload" for t in readings)
        + sum(entry.kind == "preload" and bool(entry.torque_nm) for entry in sequence),
        n_excluded_samples=sum(t.detail.n_excluded for t in readings),
        excluded_at_s=tuple(time for t in readings for time in t.detail.excluded_at_s),
    )


def _ends(values: Sequence[float | None]) -> Ends | None:
    known = [v for v in values if v is not None]
    if not known:
        return None
    return Ends(first=known[0], last=known[-1], least=min(known), largest=max(known))


def sequence_deviations(
    groups: Sequence[tuple[LoadGroup, tuple[LoadStep, ...]]], n_preloads: int
) -> tuple[str, ...]:
    """Return what departs from the sequence of the guide, in words."""
    out: list[str] = []
    for group, steps in groups:
        name, torque = f"{group.direction}, {group.range} range", group.torque_nm
        if group.n_positions < _POSITIONS:
            out.append(
                f"{name}: positions: {group.n_positions}; the guide has at least {_POSITIONS}"
            )
        if len(torque) < _STEPS:
            out.append(f"{name}: steps: {len(torque)}; the guide has at least {_STEPS}")
        first = torque[0] / torque[-1]
        if first > _FIRST_STEP + _FIRST_STEP_SLACK:
            out.append(f"{name}: first step at {100.0 * first:.0f} %; the guide begins at 20 %")
        if all(step.repeatability_v is None for step in steps):
            out.append(f"{name}: no repeated series in one mounting, so no repeatability b'")
        if group.linear_up_down_v_per_nm is None:
            out.append(f"{name}: no decreasing torque, so no reversibility h")
        if group.zero_v is None:
            out.append(f"{name}: no zero before and after a series, so no f0")
        if group.zero_by_line:
            out.append(f"{name}: no zero reading; the intercept of the line stands for it")
    if not n_preloads:
        out.append("no preloads are told of; the guide has three before the first series")
    return tuple(out)


def shunt_record(
    readings: Sequence[TakenReading],
    sequence: Sequence[SequenceEntry],
    shunt: ShuntCheck | None,
    gain_nm_per_v: float,
) -> ShuntRecord | None:
    """Return the shunt readings, and whether they are those of the last calibration."""
    volts = [t.reading.reading_v for t in readings if t.detail.kind == "shunt"]
    volts += [e.reading_v for e in sequence if e.kind == "shunt" and e.reading_v is not None]
    if not volts and shunt is None:
        return None
    mean = sum(volts) / len(volts) if volts else None
    expected = None if shunt is None else shunt.expected_v
    change = mean / expected - 1.0 if mean is not None and expected else None
    limit = None if shunt is None else shunt.tolerance
    return ShuntRecord(
        resistor_ohm=None if shunt is None else shunt.resistor_ohm,
        reading_v=mean,
        n=len(volts),
        expected_v=expected,
        change=change,
        tolerance=limit,
        within=None if change is None or limit is None else abs(change) <= limit,
        torque_equivalent_nm=None if mean is None else gain_nm_per_v * mean,
    )
