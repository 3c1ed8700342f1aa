"""The readings of one experiment, load by load."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hdbench.records.loads import LoadReading

__all__ = ["LoadStep", "load_steps"]

# torques of one load step differ by less than this share of the largest torque
_STEP_SHARE = 1e-6


@dataclass(frozen=True, slots=True)
class LoadStep:
    """Readings of one experiment under one applied torque.

    Parameters
    ----------
    torque_nm : float
        Applied torque, N m.
    reading_up_v, reading_down_v : float or None
        Mean reading while loading and while unloading, V; None where there is none.
    hysteresis_v : float or None
        Unloading minus loading, V.
    deviation_nm : float
        Applied torque minus the experiment's line at the mean reading, N m.
    """

    torque_nm: float
    reading_up_v: float | None
    reading_down_v: float | None
    hysteresis_v: float | None
    deviation_nm: float

    def to_dict(self) -> dict[str, float | None]:
        """Return the step as results store it."""
        return {
            "torque_nm": self.torque_nm,
            "reading_up_v": self.reading_up_v,
            "reading_down_v": self.reading_down_v,
            "hysteresis_v": self.hysteresis_v,
            "deviation_nm": self.deviation_nm,
        }


def load_steps(
    readings: Sequence[LoadReading], gain: float, intercept: float
) -> tuple[LoadStep, ...]:
    """Return the steps of one experiment, by applied torque."""
    largest = max(abs(r.torque_nm) for r in readings)
    groups: list[list[LoadReading]] = []
    for reading in sorted(readings, key=lambda r: r.torque_nm):
        last = groups[-1][0].torque_nm if groups else math.inf
        if groups and abs(reading.torque_nm - last) <= _STEP_SHARE * largest:
            groups[-1].append(reading)
        else:
            groups.append([reading])
    return tuple(_load_step(group, gain, intercept) for group in groups)


def _load_step(group: list[LoadReading], gain: float, intercept: float) -> LoadStep:
    def mean(series: str) -> float | None:
        values = [r.reading_v for r in group if r.series == series]
        return math.fsum(values) / len(values) if values else None

    up, down = mean("up"), mean("down")
    reading = math.fsum(r.reading_v for r in group) / len(group)
    return LoadStep(
        torque_nm=group[0].torque_nm,
        reading_up_v=up,
        reading_down_v=down,
        hysteresis_v=None if up is None or down is None else down - up,
        deviation_nm=group[0].torque_nm - (gain * reading + intercept),
    )
