"""Plateaus and the loads they belong to, as readings of a calibration."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass

from hdbench.calibration.staircase.plateaus import Plateau, Staircase
from hdbench.errors import DataError
from hdbench.profile.calibrating import Arm
from hdbench.records.loads import LoadReading, Loads

__all__ = ["KILOGRAM", "StaircasePlace", "staircase_loads"]

# kg of each unit of load that is a mass; the avoirdupois pound is exact by definition (1959)
KILOGRAM = {"kg": 1.0, "lb": 0.45359237}


@dataclass(frozen=True, slots=True)
class StaircasePlace:
    """What a staircase belongs to.

    Parameters
    ----------
    experiment : str
        Identifier.
    position_rad : float
        Flexspline position, rad.
    range : str
        ``low`` or ``full``.
    direction : str
        ``cw`` or ``ccw``.
    """

    experiment: str = "staircase"
    position_rad: float = 0.0
    range: str = "full"
    direction: str = "cw"


def staircase_loads(
    stairs: Staircase,
    loads: Sequence[float],
    unit: str,
    place: StaircasePlace,
    arm: Arm,
    *,
    source: str,
) -> Loads:
    """Give every plateau its load."""
    found = stairs.plateaus
    _check(found, loads, source)
    top = max(range(len(loads)), key=lambda k: loads[k])
    sign = 1.0 if place.direction == "cw" else -1.0
    readings = []
    for k, (plateau, load) in enumerate(zip(found, loads, strict=True)):
        mass = None if unit == "nm" else load * KILOGRAM[unit]
        torque = load if mass is None else mass * arm.gravity_m_s2 * arm.length_m
        readings.append(
            LoadReading(
                place.experiment,
                place.position_rad,
                place.range,
                place.direction,
                "up" if k <= top else "down",
                sign * torque,
                plateau.mean,
                mass_kg=mass,
                reading_std_v=plateau.std,
                n_samples=plateau.n,
                time_s=(plateau.start_s + plateau.end_s) / 2.0,
            )
        )
    return Loads(tuple(readings), source, {}, _columns(stairs))


def _check(found: Sequence[Plateau], loads: Sequence[float], source: str) -> None:
    for k, load in enumerate(loads):
        if not (math.isfinite(load) and load >= 0.0):
            raise DataError(
                f"load {k + 1} is {load!r}; needed: a finite number of at least 0",
                where="--loads",
                fix="give loads without sign; the direction gives it",
            )
    if len(found) != len(loads):
        listed = "; ".join(f"{p.start_s:.1f} to {p.end_s:.1f} s at {p.mean:g}" for p in found[:20])
        raise DataError(
            f"found {len(found)} plateaus for {len(loads)} loads ({listed or 'none'})",
            where=source,
            fix="give one load for each plateau with --loads, or another --least-s",
        )


def _columns(stairs: Staircase) -> dict[str, tuple[str, ...]]:
    """Return the optional columns; an excluded sample belongs to the plateau that it ends in."""
    found = stairs.plateaus
    glitches, stuck = _shared(stairs.glitches_at_s, found), _shared(stairs.stuck_at_s, found)
    excluded = [
        sorted(a) if plateau.stuck_kept else sorted((*a, *b))
        for a, b, plateau in zip(glitches, stuck, found, strict=True)
    ]
    flags = [
        ";".join(name for name, times in (("glitches", a), ("stuck", b)) if times)
        for a, b in zip(glitches, stuck, strict=True)
    ]
    return {
        "slope_v_s": tuple(repr(p.slope_per_s) for p in found),
        "autocorrelation": tuple(repr(p.autocorrelation) for p in found),
        "flags": tuple(flags),
        "n_excluded": tuple(str(len(times)) for times in excluded),
        "excluded_at_s": tuple(";".join(f"{t:.9g}" for t in times) for times in excluded),
    }


def _shared(times: Sequence[float], found: Sequence[Plateau]) -> list[list[float]]:
    """Share times out among plateaus: one on the way to a plateau is that plateau's."""
    ends = [p.end_s for p in found[:-1]]
    out: list[list[float]] = [[] for _ in found]
    for time in times:
        out[bisect.bisect_left(ends, time)].append(time)
    return out
