"""Static readings of a calibration, and their file (contract section 4)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

from hdbench.errors import DataError
from hdbench.records import csvtext
from hdbench.records.storage import write_atomic

LOADS_COLUMNS = (
    "experiment",
    "position_rad",
    "range",
    "direction",
    "series",
    "torque_nm",
    "mass_kg",
    "reading_v",
    "reading_std_v",
    "n_samples",
    "time_s",
    "temperature_c",
)
"""Columns that the contract names, in the order in which they are written."""
LOADS_OPTIONAL = (
    "kind",
    "repeat",
    "mounting",
    "loading",
    "arm_length_m",
    "settle_s",
    "slope_v_s",
    "autocorrelation",
    "flags",
    "n_excluded",
    "excluded_at_s",
    "wave_generator_rad",
    "humidity_percent",
    "pressure_hpa",
)
"""Columns that the calibration understands beside the contract's; kept as text by the reader."""
SEQUENCE_NAME = "sequence.csv"
_NEEDED = ("experiment", "position_rad", "range", "direction", "series", "reading_v")
_WORDS = {"range": ("low", "full"), "direction": ("cw", "ccw"), "series": ("up", "down")}
_OPTIONAL = ("mass_kg", "reading_std_v", "n_samples", "time_s", "temperature_c")
_NOT_NEGATIVE = ("mass_kg", "reading_std_v", "n_samples")


@dataclass(frozen=True, slots=True)
class LoadReading:
    """One accepted reading under one weight (contract section 4).

    Parameters
    ----------
    experiment : str
        Identifier of the loading experiment (one fitted line).
    position_rad : float
        Flexspline position, rad.
    range : str
        ``low`` or ``full``.
    direction : str
        ``cw`` or ``ccw``.
    series : str
        ``up`` (loading) or ``down`` (unloading).
    torque_nm : float
        Applied torque, N m; cw positive.
    reading_v : float
        Amplified bridge output, V.
    mass_kg : float or None
        Mass on the arm, kg, where the torque came from one.
    reading_std_v : float or None
        Standard deviation of the samples averaged, V.
    n_samples : int or None
        How many samples were averaged.
    time_s : float or None
        Time since the start of the calibration, s.
    temperature_c : float or None
        Temperature, degrees Celsius.
    """

    experiment: str
    position_rad: float
    range: str
    direction: str
    series: str
    torque_nm: float
    reading_v: float
    mass_kg: float | None = None
    reading_std_v: float | None = None
    n_samples: int | None = None
    time_s: float | None = None
    temperature_c: float | None = None


@dataclass(frozen=True, slots=True)
class Loads:
    """All readings of a calibration, in the order they were taken.

    Parameters
    ----------
    readings : tuple of LoadReading
        The readings.
    source : str
        Where they came from.
    metadata : mapping
        What is known beside the readings (lock angle, operator).
    extra_columns : mapping of str to tuple of str
        Columns of the file that the contract does not name, kept as text.
    """

    readings: tuple[LoadReading, ...]
    source: str = "<memory>"
    metadata: Mapping[str, Any] = field(default_factory=dict)
    extra_columns: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.readings)


@dataclass(frozen=True, slots=True)
class SequenceEntry:
    """One thing that happened."""

    kind: str  # `zero`, `preload`, `reading`, `shunt` or `remounted`
    experiment: str  # loading experiment that it belongs to; empty where it belongs to none
    superseded: str  # why a reading counts no more; empty where it counts
    # time since the start, s; applied torque, N m; reading, V. None where not told
    time_s: float | None
    torque_nm: float | None
    reading_v: float | None

    def to_dict(self) -> dict[str, object]:
        """Return the entry as results store it."""
        return asdict(self)


class ArmLike(Protocol):
    """The arm that turns a mass into a torque."""

    @property
    def length_m(self) -> float:
        """Axis to hanging point, m."""
        ...

    @property
    def gravity_m_s2(self) -> float:
        """Local gravity, m/s^2."""
        ...


class _Row:
    """One row of a loads file: cells by column, errors with the line."""

    def __init__(self, path: Path, line: int, cells: Mapping[str, str]) -> None:
        self.path, self.line, self.cells = path, line, cells

    def error(self, name: str, needed: str) -> DataError:
        cell = self.cells[name][:40]
        what = f"column {name!r} holds {cell!r}; needed: {needed}"
        return csvtext.data_error(self.path, self.line, what, "correct the cell")

    def word(self, name: str) -> str:
        value = self.cells[name].strip()
        allowed = _WORDS.get(name)
        if allowed is not None and value not in allowed:
            raise self.error(name, " or ".join(allowed))
        if not value:
            raise self.error(name, "an identifier")
        return value

    def number(self, name: str) -> float:
        cell = self.cells[name].strip()
        try:
            value = float(cell) if cell.isascii() and "_" not in cell else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(name, "a finite number")
        if name in _NOT_NEGATIVE and not value >= 0.0:
            raise self.error(name, "a number of at least 0")
        return value

    def optional(self, name: str) -> float | None:
        cell = self.cells.get(name, "").strip()
        return None if cell.lower() in ("", "nan") else self.number(name)

    def count(self, name: str) -> int | None:
        value = self.optional(name)
        if value is None:
            return None
        if not (value >= 1.0 and value == math.floor(value)):
            raise self.error(name, "a whole number of at least 1")
        return int(value)

    def torque_nm(self, arm: ArmLike | None, direction: str) -> float:
        given = "torque_nm" in self.cells
        if given and (self.cells["torque_nm"].strip() or not self.cells.get("mass_kg", "").strip()):
            return self.number("torque_nm")
        mass_kg = self.number("mass_kg")
        if arm is None:
            raise csvtext.data_error(
                self.path,
                1,
                "masses without an arm; needed: column torque_nm, or a profile with [arm]",
                "name the bench with --profile",
            )
        sign = 1.0 if direction == "cw" else -1.0
        return sign * mass_kg * arm.gravity_m_s2 * arm.length_m


def _reading(row: _Row, arm: ArmLike | None) -> LoadReading:
    direction = row.word("direction")
    return LoadReading(
        experiment=row.word("experiment"),
        position_rad=row.number("position_rad"),
        range=row.word("range"),
        direction=direction,
        series=row.word("series"),
        torque_nm=row.torque_nm(arm, direction),
        reading_v=row.number("reading_v"),
        mass_kg=row.optional("mass_kg"),
        reading_std_v=row.optional("reading_std_v"),
        n_samples=row.count("n_samples"),
        time_s=row.optional("time_s"),
        temperature_c=row.optional("temperature_c"),
    )


def read_loads(path: Path, arm: ArmLike | None) -> Loads:
    """Read the loads of a calibration.

    Parameters
    ----------
    path : Path
        A ``.csv`` or ``.csv.gz`` file.
    arm : Arm or None
        Arm of the profile; needed where the file gives masses and no torque.

    Returns
    -------
    Loads
        Readings in file order; columns that the contract does not name as text. ``sequence`` in
        the metadata holds the course of the calibration, where ``sequence.csv`` lies beside it.

    Raises
    ------
    DataError
        If the file is missing or damaged, a column is missing, or a cell is out of its domain
        (with line and column).

    Notes
    -----
    Where a row states no torque: torque = sign * mass * g * length, the sign positive for ``cw``
    and negative for ``ccw``.
    """
    path = Path(path)
    table = csvtext.parse_table(path, csvtext.read_text(path, "loads file"))
    for name in _NEEDED:
        if name not in table.header:
            raise csvtext.data_error(path, 1, f"no column {name}", csvtext.IMPORT_FIX)
    if not {"torque_nm", "mass_kg"} & set(table.header):
        raise csvtext.data_error(path, 1, "no column torque_nm or mass_kg", csvtext.IMPORT_FIX)
    readings = tuple(
        _reading(_Row(path, line, dict(zip(table.header, row, strict=True))), arm)
        for line, row in zip(table.lines, table.rows, strict=True)
    )
    columns = zip(table.header, zip(*table.rows, strict=True), strict=True)
    extra = {name: cells for name, cells in columns if name not in LOADS_COLUMNS}
    course = read_sequence(path.with_name(SEQUENCE_NAME))
    return Loads(readings, str(path), {"sequence": course} if course else {}, extra)


def read_sequence(path: Path) -> tuple[SequenceEntry, ...]:
    """Read the course of a calibration."""
    path = Path(path)
    if not path.is_file():
        return ()
    table = csvtext.parse_table(path, csvtext.read_text(path, "sequence file"))
    out = []
    for line, cells in zip(table.lines, table.rows, strict=True):
        row = _Row(path, line, dict(zip(table.header, cells, strict=True)))
        numbers = [row.optional(name) for name in ("time_s", "torque_nm", "reading_v")]
        words = [row.cells.get(name, "").strip() for name in ("kind", "experiment", "superseded")]
        out.append(SequenceEntry(words[0], words[1], words[2], *numbers))
    return tuple(out)


def write_loads(path: Path, loads: Loads) -> None:
    """Write loads atomically; `read_loads` gives the same readings back."""
    if not loads.readings:
        raise DataError("no readings", where=loads.source, fix="take at least one reading")
    names = [
        name
        for name in LOADS_COLUMNS
        if name not in _OPTIONAL or any(getattr(r, name) is not None for r in loads.readings)
    ]
    rows = []
    for index, reading in enumerate(loads.readings):
        values = [getattr(reading, name) for name in names]
        if any(isinstance(value, float) and not math.isfinite(value) for value in values):
            raise DataError(
                f"reading {index + 1} of {len(loads)} is not finite",
                where=loads.source,
                fix="take this reading again",
            )
        rows.append([*values, *(cells[index] for cells in loads.extra_columns.values())])
    write_atomic(Path(path), csvtext.csv_text([*names, *loads.extra_columns], rows).encode())


def is_loads_file(path: Path) -> bool:
    """Tell loads from a trace by the columns.

    Parameters
    ----------
    path : Path
        A ``.csv`` or ``.csv.gz`` file.

    Returns
    -------
    bool
        True when there is a column ``reading_v`` beside ``torque_nm`` or ``mass_kg``.

    Raises
    ------
    DataError
        If the file cannot be read or its header is wrong.
    """
    header = set(csvtext.read_header(Path(path)))
    return "reading_v" in header and bool(header & {"torque_nm", "mass_kg"})
