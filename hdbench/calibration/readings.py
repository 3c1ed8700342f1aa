"""Readings of a loads file, with the details that stand beyond the contract's columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from hdbench.profile.schema import ProfileData
from hdbench.records.loads import LoadReading, Loads
from hdbench.results import Part
from hdbench.results.calibration import ReadingRecord

# flags that a normal course writes and that leave nothing to doubt
_HARMLESS = frozenset({"", "accepted", "repeated"})
_Count = Annotated[int, Field(ge=0)]
_Positive = Annotated[float, Field(gt=0.0)]
# decimals in which a display may count; finer readings are averages without a visible increment
_DECIMALS = range(7)


def _parts(cell: object) -> object:
    """Return the parts of a cell, remarks of a normal course left out."""
    if not isinstance(cell, str):
        return cell
    return tuple(word for part in cell.split(";") if (word := part.strip()) not in _HARMLESS)


class ReadingDetail(Part):
    """Optional columns of one reading, None where they do not tell."""

    kind: Literal["reading", "preload", "shunt"] = "reading"
    # number of the series in its mounting, from 0; number of the mounting
    repeat: _Count | None = None
    mounting: _Count | None = None
    loading: Literal["single", "couple"] | None = None
    # another arm than the profile's
    arm_length_m: _Positive | None = None
    pressure_hpa: _Positive | None = None
    humidity_percent: float | None = None
    # time from the change of load to the reading; slope of the averaged samples
    settle_s: float | None = None
    slope_v_s: float | None = None
    # samples left out of the average, and their times
    n_excluded: _Count = 0
    excluded_at_s: Annotated[tuple[float, ...], BeforeValidator(_parts)] = ()
    # what was remarked
    flags: Annotated[tuple[str, ...], BeforeValidator(_parts)] = ()


_OPTIONAL_COLUMNS = frozenset(field.name for field in fields(ReadingDetail))


@dataclass(frozen=True, slots=True)
class TakenReading:
    """A reading with its place in the file and its optional columns."""

    # place in the loads, from 0
    index: int
    reading: LoadReading
    detail: ReadingDetail

    def record(self) -> ReadingRecord:
        """Return the reading as results hold it."""
        known = {**asdict(self.reading), **self.detail.to_json()}
        return ReadingRecord.from_json(known, f"reading {self.index + 1}")


def taken_readings(loads: Loads) -> tuple[TakenReading, ...]:
    """Return all readings with their optional columns."""
    columns = {
        name: cells for name, cells in loads.extra_columns.items() if name in _OPTIONAL_COLUMNS
    }
    taken = []
    for index, reading in enumerate(loads.readings):
        cells = {name: column[index].strip() for name, column in columns.items()}
        told = {name: cell for name, cell in cells.items() if cell.lower() not in ("", "nan")}
        where = f"{loads.source}: reading {index + 1}, column"
        detail = ReadingDetail.from_json(told, where, "correct the cell, or empty it")
        taken.append(TakenReading(index, reading, detail))
    return tuple(taken)


def flagged(readings: tuple[TakenReading, ...]) -> dict[str, tuple[int, ...]]:
    """Return which readings bear which remark."""
    found: dict[str, list[int]] = {}
    for taken in readings:
        for word in taken.detail.flags:
            found.setdefault(word, []).append(taken.index)
    return {word: tuple(places) for word, places in found.items()}


def reading_resolution(readings: Sequence[TakenReading], bench: ProfileData | None) -> float | None:
    """Return the declared resolution, else the decimal step that all readings share."""
    if bench is not None and bench.standards.instrument.resolution_v is not None:
        return bench.standards.instrument.resolution_v
    volts = {t.reading.reading_v for t in readings}
    if len(volts) < 3:
        return None
    return next(
        (10.0**-d for d in _DECIMALS if all(round(v, d) == v for v in volts)),
        None,
    )
