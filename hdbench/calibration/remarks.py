"""What is remarked on a calibration beside its numbers: doubts and notes."""

from __future__ import annotations

from collections.abc import Sequence

from hdbench.calibration.readings import TakenReading, flagged
from hdbench.calibration.torque.applied import TorqueAccount
from hdbench.results import DataFlag
from hdbench.results.calibration import ExperimentLine

__all__ = ["doubts_of", "notes_of"]

# places named in a sentence
_SHOWN = 10


def doubts_of(lines: Sequence[ExperimentLine]) -> tuple[DataFlag, ...]:
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
    lines: Sequence[ExperimentLine],
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
