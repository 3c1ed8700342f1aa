"""What a loads file tells of each reading beyond the contract's columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hdbench.errors import DataError
from hdbench.profile.schema import ProfileData
from hdbench.records.loads import LoadReading, Loads
from hdbench.results.calibration import ReadingRecord

__all__ = ["ReadingDetail", "TakenReading", "flagged", "reading_resolution", "taken_readings"]

_KINDS = ("reading", "preload", "shunt")
_LOADINGS = ("", "single", "couple")
# flags that a normal course writes and that leave nothing to doubt
_HARMLESS = frozenset({"", "accepted", "repeated"})
# decimals in which a display may count; finer readings are averages without a visible increment
_DECIMALS = range(7)


@dataclass(frozen=True, slots=True)
class ReadingDetail:
    """Optional columns of one reading, None where they do not tell.

    Parameters
    ----------
    kind : str
        ``reading``, ``preload`` or ``shunt``.
    repeat, mounting : int or None
        Number of the series in its mounting, from 0; number of the mounting.
    loading : str or None
        ``single`` or ``couple``.
    arm_length_m : float or None
        Another arm, m.
    pressure_hpa, humidity_percent : float or None
        Air.
    settle_s, slope_v_s : float or None
        Time from the change of load to the reading, s; slope of the averaged samples, V/s.
    n_excluded : int
        Samples left out of the average.
    excluded_at_s : tuple of float
        Their times, s.
    flags : tuple of str
        What was remarked.
    """

    kind: str = "reading"
    repeat: int | None = None
    mounting: int | None = None
    loading: str | None = None
    arm_length_m: float | None = None
    pressure_hpa: float | None = None
    humidity_percent: float | None = None
    settle_s: float | None = None
    slope_v_s: float | None = None
    n_excluded: int = 0
    excluded_at_s: tuple[float, ...] = ()
    flags: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class TakenReading:
    """A reading with its place in the file and its optional columns.

    Parameters
    ----------
    index : int
        Place in the loads, from 0.
    reading : LoadReading
        The reading.
    detail : ReadingDetail
        Its optional columns.
    """

    index: int
    reading: LoadReading
    detail: ReadingDetail

    def record(self) -> ReadingRecord:
        """Return the reading as results hold it."""
        reading, detail = self.reading, self.detail
        return ReadingRecord(
            experiment=reading.experiment,
            series=reading.series,
            kind=detail.kind,
            torque_nm=reading.torque_nm,
            mass_kg=reading.mass_kg,
            reading_v=reading.reading_v,
            reading_std_v=reading.reading_std_v,
            n_samples=reading.n_samples,
            time_s=reading.time_s,
            temperature_c=reading.temperature_c,
            settle_s=detail.settle_s,
            slope_v_s=detail.slope_v_s,
            flags=detail.flags,
            excluded_at_s=detail.excluded_at_s,
        )


@dataclass(frozen=True, slots=True)
class _Row:
    loads: Loads
    index: int

    def text(self, name: str) -> str:
        column = self.loads.extra_columns.get(name)
        return "" if column is None else column[self.index].strip()

    def word(self, name: str, allowed: tuple[str, ...], default: str) -> str:
        text = self.text(name) or default
        if text not in allowed:
            raise self.error(name, text, " or ".join(word for word in allowed if word))
        return text

    def number(self, name: str) -> float | None:
        text = self.text(name)
        if text.lower() in ("", "nan"):
            return None
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(name, text, "a finite number")
        return value

    def positive(self, name: str) -> float | None:
        value = self.number(name)
        if value is not None and not value > 0.0:
            raise self.error(name, self.text(name), "a number above 0")
        return value

    def count(self, name: str) -> int | None:
        value = self.number(name)
        if value is None:
            return None
        if not (value >= 0.0 and value == math.floor(value)):
            raise self.error(name, self.text(name), "a whole number of at least 0")
        return int(value)

    def numbers(self, name: str) -> tuple[float, ...]:
        words = [word.strip() for word in self.text(name).split(";") if word.strip()]
        try:
            values = tuple(float(word) for word in words)
        except ValueError:
            values = (math.nan,)
        if not all(math.isfinite(value) for value in values):
            raise self.error(name, self.text(name), "numbers with ';' between")
        return values

    def error(self, name: str, found: str, needed: str) -> DataError:
        return DataError(
            f"column {name} holds {found!r}; needed: {needed}",
            where=f"{self.loads.source}: reading {self.index + 1}, column {name}",
            fix="correct the cell, or empty it",
        )


def taken_readings(loads: Loads) -> tuple[TakenReading, ...]:
    """Return all readings with their optional columns."""
    return tuple(
        TakenReading(index, reading, _detail(_Row(loads, index)))
        for index, reading in enumerate(loads.readings)
    )


def _detail(row: _Row) -> ReadingDetail:
    flags = tuple(word.strip() for word in row.text("flags").split(";"))
    return ReadingDetail(
        kind=row.word("kind", _KINDS, "reading"),
        repeat=row.count("repeat"),
        mounting=row.count("mounting"),
        loading=row.word("loading", _LOADINGS, "") or None,
        arm_length_m=row.positive("arm_length_m"),
        pressure_hpa=row.positive("pressure_hpa"),
        humidity_percent=row.number("humidity_percent"),
        settle_s=row.number("settle_s"),
        slope_v_s=row.number("slope_v_s"),
        n_excluded=row.count("n_excluded") or 0,
        excluded_at_s=row.numbers("excluded_at_s"),
        flags=tuple(word for word in flags if word not in _HARMLESS),
    )


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
