"""Readings as results store them, and their resolution."""

from __future__ import annotations

from collections.abc import Sequence

from hdbench.calibration.readings import TakenReading
from hdbench.profile.schema import ProfileData

__all__ = ["reading_dict", "reading_resolution"]

# decimals in which a display may count; finer readings are averages without a visible increment
_DECIMALS = range(7)


def reading_dict(taken: TakenReading) -> dict[str, object]:
    """Return a reading as results store it."""
    reading, detail = taken.reading, taken.detail
    return {
        "experiment": reading.experiment,
        "series": reading.series,
        "kind": detail.kind,
        "torque_nm": reading.torque_nm,
        "mass_kg": reading.mass_kg,
        "reading_v": reading.reading_v,
        "reading_std_v": reading.reading_std_v,
        "n_samples": reading.n_samples,
        "time_s": reading.time_s,
        "temperature_c": reading.temperature_c,
        "settle_s": detail.settle_s,
        "slope_v_s": detail.slope_v_s,
        "flags": list(detail.flags),
        "excluded_at_s": list(detail.excluded_at_s),
    }


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
