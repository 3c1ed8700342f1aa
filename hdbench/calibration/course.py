"""Course of a calibration: environment, shunt, departures from a standard, doubts and notes."""

from __future__ import annotations

from collections.abc import Sequence

from hdbench.calibration.lever import TorqueAccount
from hdbench.calibration.readings import TakenReading, flagged
from hdbench.profile.calibrating import ShuntCheck
from hdbench.records.loads import SequenceEntry
from hdbench.results import DataFlag
from hdbench.results import calibration as record

# places named in a sentence
_SHOWN = 10
# in the manner of EURAMET cg-14: positions, steps for the coarsest classes, share of the largest
# torque at which the steps begin
_POSITIONS, _STEPS, _FIRST_STEP = 3, 3, 0.2
# a first step written as 20 % may be 20.4 % by the weights at hand
_FIRST_STEP_SLACK = 0.055


def course_of(readings: Sequence[TakenReading], sequence: Sequence[SequenceEntry]) -> record.Course:
    """Return environment and times of the readings."""
    return record.Course(
        temperature_c=_ends([t.reading.temperature_c for t in readings]),
        humidity_percent=_ends([t.detail.humidity_percent for t in readings]),
        pressure_hpa=_ends([t.detail.pressure_hpa for t in readings]),
        time_s=_ends([t.reading.time_s for t in readings]),
        n_preloads=sum(t.detail.kind == "preload" for t in readings)
        + sum(entry.kind == "preload" and bool(entry.torque_nm) for entry in sequence),
        n_excluded_samples=sum(t.detail.n_excluded for t in readings),
        excluded_at_s=tuple(time for t in readings for time in t.detail.excluded_at_s),
    )


def _ends(values: Sequence[float | None]) -> record.Ends | None:
    known = [v for v in values if v is not None]
    if not known:
        return None
    return record.Ends(first=known[0], last=known[-1], least=min(known), largest=max(known))


def sequence_deviations(
    groups: Sequence[tuple[record.LoadGroup, tuple[record.LoadStep, ...]]], n_preloads: int
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
) -> record.ShuntRecord | None:
    """Return the shunt readings, and whether they are those of the last calibration."""
    volts = [t.reading.reading_v for t in readings if t.detail.kind == "shunt"]
    volts += [e.reading_v for e in sequence if e.kind == "shunt" and e.reading_v is not None]
    if not volts and shunt is None:
        return None
    mean = sum(volts) / len(volts) if volts else None
    expected = None if shunt is None else shunt.expected_v
    change = mean / expected - 1.0 if mean is not None and expected else None
    limit = None if shunt is None else shunt.tolerance
    return record.ShuntRecord(
        resistor_ohm=None if shunt is None else shunt.resistor_ohm,
        reading_v=mean,
        n=len(volts),
        expected_v=expected,
        change=change,
        tolerance=limit,
        within=None if change is None or limit is None else abs(change) <= limit,
        torque_equivalent_nm=None if mean is None else gain_nm_per_v * mean,
    )


def doubts_of(lines: Sequence[record.ExperimentLine]) -> tuple[DataFlag, ...]:
    """Return what makes the data doubtful: gains of both signs."""
    below = [line for line in lines if line.gain_nm_per_v < 0.0]
    above = [line for line in lines if line.gain_nm_per_v > 0.0]
    if not (below and above):
        return ()
    fewer, word = (below, "negative") if len(below) <= len(above) else (above, "positive")
    names = ", ".join(line.id for line in fewer)
    detail = (
        f"the gain of experiment {names} is {word}, unlike that of the others: torque or reading "
        "has the wrong sign; kept in the mean"
    )
    return (DataFlag("gain-sign", sum(line.n for line in fewer), detail),)


def notes_of(
    lines: Sequence[record.ExperimentLine],
    readings: tuple[TakenReading, ...],
    account: TorqueAccount,
    basis: tuple[str, str],
) -> tuple[DataFlag, ...]:
    """Return what limits the evaluation of sound data."""
    notes = []
    n_doubtful = sum(len(line.doubtful) for line in lines)
    if n_doubtful:
        names = ", ".join(line.id for line in lines if line.doubtful)
        stand = "1 reading stands" if n_doubtful == 1 else f"{n_doubtful} readings stand"
        detail = f"{stand} off the line of experiment {names}; kept in the fit"
        notes.append(DataFlag("doubtful-readings", n_doubtful, detail))
    notes += _twice(readings)
    if account.n_stated:
        detail = (
            f"{account.n_stated} torques are not mass x gravity x length of the profile's arm: "
            "they stay as stated, without corrections"
        )
        notes.append(DataFlag("torque-as-stated", account.n_stated, detail))
    if basis[0] != "positions":
        notes.append(DataFlag(f"gain-{basis[0]}", sum(line.n for line in lines), basis[1]))
    for word, places in flagged(readings).items():
        which = _numbers(places)
        detail = f"{which} marked {word!r}; kept in the evaluation"
        notes.append(DataFlag(f"marked-{word}", len(places), detail))
    excluded = sum(t.detail.n_excluded for t in readings)
    if excluded:
        detail = (
            f"{excluded} samples were left out of the averages as glitches; their times are kept"
        )
        notes.append(DataFlag("excluded-samples", excluded, detail))
    return tuple(notes)


def _twice(readings: tuple[TakenReading, ...]) -> list[DataFlag]:
    """Return a note where a reading stands in the file more than once."""
    seen: dict[object, int] = {}
    again: list[int] = []
    for taken in readings:
        if seen.setdefault((taken.reading, taken.detail), taken.index) != taken.index:
            again.append(taken.index)
    if not again:
        return []
    detail = (
        f"{_numbers(again)} equal in every column to one before: written twice? Kept in the fit"
    )
    return [DataFlag("repeated-rows", len(again), detail)]


def _numbers(places: Sequence[int]) -> str:
    """Return places counted from 1 as the subject of a sentence, the first ones of many."""
    if len(places) == 1:
        return f"reading {places[0] + 1} is"
    more = " ..." if len(places) > _SHOWN else ""
    return "readings " + ", ".join(str(place + 1) for place in places[:_SHOWN]) + more + " are"
