"""Static readings of a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["LoadReading", "Loads"]


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
