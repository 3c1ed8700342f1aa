"""Gross errors: a reading that is far off, and the weight that would explain it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hdbench.profile.schema import ProfileData
from hdbench.session.calibrating.points import Point

__all__ = ["Expectation", "GrossError", "Guard"]

# Readings with weight needed before their own gain replaces the profile's: the median of three
# stands even if one of them is wrong.
_LEAST_READINGS = 3

# Share of the smallest step between weights within which a weight explains a reading.
_EXPLAINS = 0.3


@dataclass(frozen=True, slots=True)
class Expectation:
    """What a reading should be.

    Parameters
    ----------
    zero_v : float
        Reading without weight in this mounting, V.
    gain_nm_per_v : float
        Gain: the profile's, or the median of what the accepted readings say, N m/V.
    """

    zero_v: float
    gain_nm_per_v: float

    @classmethod
    def of(
        cls, zero_v: float, accepted: Sequence[tuple[float, float]], gain_nm_per_v: float
    ) -> Expectation:
        """Return what the accepted readings lead to expect."""
        gains = [torque / volts for torque, volts in accepted if volts != 0.0]
        if len(gains) >= _LEAST_READINGS and float(np.median(gains)) != 0.0:
            return cls(zero_v, float(np.median(gains)))
        return cls(zero_v, gain_nm_per_v)

    def volts(self, torque_nm: float) -> float:
        """Return the reading expected of a torque, V."""
        return self.zero_v + torque_nm / self.gain_nm_per_v

    def torque_nm(self, reading_v: float) -> float:
        """Return the torque that a reading means, N m."""
        return (reading_v - self.zero_v) * self.gain_nm_per_v


@dataclass(frozen=True, slots=True)
class GrossError:
    """A reading that does not fit its weight.

    Parameters
    ----------
    expected_nm, read_nm : float
        Torques, N m.
    guess : str or None
        What would explain it; None where no weight does.
    """

    expected_nm: float
    read_nm: float
    guess: str | None

    def describe(self) -> str:
        """Return the question in words."""
        asked = self.guess or "no weight of the set explains it: check arm, side and cable"
        return f"expected {self.expected_nm:+.2f} N m, read {self.read_nm:+.2f} N m: {asked}"


@dataclass(frozen=True, slots=True)
class Guard:
    """The weights of a sequence on the arm of a bench.

    Parameters
    ----------
    weights_kg : tuple of float
        Every mass that is hung, kg, ascending, with 0.
    lever_nm_per_kg : float
        Torque of a mass, N m/kg.
    tare_kg : float
        Pan and hook that come on with the first weight, kg.
    """

    weights_kg: tuple[float, ...]
    lever_nm_per_kg: float
    tare_kg: float

    @classmethod
    def of(cls, points: Sequence[Point], profile: ProfileData) -> Guard:
        """Return the guard of a sequence."""
        masses = {0.0, *(point.mass_kg for point in points)}
        lever = profile.arm.gravity_m_s2 * profile.arm.length_m
        return cls(tuple(sorted(masses)), lever, profile.arm.tare_kg)

    def find(
        self, point: Point, reading_v: float, expectation: Expectation, share: float
    ) -> GrossError | None:
        """Compare a reading with its weight."""
        read_nm = expectation.torque_nm(reading_v)
        if abs(read_nm - point.torque_nm) <= share * point.step_nm:
            return None
        return GrossError(point.torque_nm, read_nm, self._guess(point, read_nm))

    def _guess(self, point: Point, read_nm: float) -> str | None:
        """Return which weight, on which side, would give the torque."""
        sign = -1.0 if point.direction == "ccw" else 1.0
        candidates = [
            (side, mass)
            for mass in self.weights_kg
            for side in (sign, -sign)
            if (side, mass) != (sign, point.mass_kg)
        ]

        def distance_nm(candidate: tuple[float, float]) -> float:
            side, mass = candidate
            hung_kg = mass + (self.tare_kg if mass else 0.0)
            return abs(read_nm - side * self.lever_nm_per_kg * hung_kg)

        side, mass = min(candidates, key=distance_nm)
        step_kg = min((b - a for a, b in pairwise(self.weights_kg)), default=0.0)
        near_nm = _EXPLAINS * self.lever_nm_per_kg * step_kg
        # written so that a reading that is no number has no explanation
        if not distance_nm((side, mass)) <= near_nm:
            return None
        if mass == 0.0:
            return "does no weight hang?"
        other = "" if side == sign else f" on the {'ccw' if side < 0.0 else 'cw'} side"
        return f"did you hang {mass:g} kg{other}?"
