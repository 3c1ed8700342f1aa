"""Static readings of a calibration, and the columns of their file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

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
    """One thing that happened.

    Parameters
    ----------
    kind : str
        ``zero``, ``preload``, ``reading``, ``shunt`` or ``remounted``.
    experiment : str
        Loading experiment that it belongs to; empty where it belongs to none.
    superseded : str
        Why a reading counts no more; empty where it counts.
    time_s, torque_nm, reading_v : float or None
        Time since the start, s; applied torque, N m; reading, V. None where not told.
    """

    kind: str
    experiment: str
    superseded: str
    time_s: float | None
    torque_nm: float | None
    reading_v: float | None

    def to_dict(self) -> dict[str, object]:
        """Return the entry as results store it."""
        return asdict(self)
