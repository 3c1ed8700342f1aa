"""What the journal keeps of a reading."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from hdbench.records.loads import LoadReading
from hdbench.session.calibrating.points import Point
from hdbench.session.calibrating.reading import Taken
from hdbench.session.calibrating.state import CalibrationState

__all__ = ["reading_entry"]


def reading_entry(
    point: Point, taken: Taken, state: CalibrationState, flags: list[str], time_s: float
) -> dict[str, Any]:
    """Return one reading as the journal keeps it."""
    reading = taken.reading
    load = LoadReading(
        experiment=point.experiment,
        position_rad=point.position_rad,
        range=point.range,
        direction=point.direction,
        series=point.series,
        torque_nm=point.torque_nm,
        reading_v=reading.mean_v,
        mass_kg=point.mass_kg,
        reading_std_v=reading.std_v,
        n_samples=reading.n_samples,
        time_s=time_s,
    )
    swing = reading.swing
    return {
        **asdict(load),
        "point": point.number,
        "attempt": state.attempts.get(point.number, 1),
        "repeat": point.repeat,
        "mounting": state.mountings,
        "settled": reading.settled,
        "settle_s": taken.waited_s,
        "slope_v_s": reading.slope_v_s,
        "autocorrelation": reading.lag1,
        "swing_period_s": None if swing is None else swing.period_s,
        "swing_v": None if swing is None else swing.amplitude_v,
        "flags": ";".join(flags),
    }
