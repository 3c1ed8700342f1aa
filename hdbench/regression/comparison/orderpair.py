"""One order of two runs as a pair of vectors with their covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.records import FloatArray, Quantity
from hdbench.regression.comparison.score import Part

__all__ = ["OrderPair", "unit_vector"]

# below three standard uncertainties a phase is hardly known: the uncertainty is the same all round
_KNOWN_PHASE_SIGMA = 3.0


@dataclass(frozen=True, slots=True)
class OrderPair:
    """One order of both runs.

    Parameters
    ----------
    order : float
        Cycles per turn.
    amplitude_a, amplitude_b : Quantity
        Amplitudes, N m.
    phase_a, phase_b : Quantity
        Phases, rad.
    common : tuple of Part
        Parts of the amplitudes' uncertainty from one source, such as one gain.
    """

    order: float
    amplitude_a: Quantity
    amplitude_b: Quantity
    phase_a: Quantity
    phase_b: Quantity
    common: tuple[Part, ...] = ()

    def vectors(self, shift_rad: float = 0.0) -> tuple[complex, complex]:
        """Return both as complex amplitudes, the second turned back by a shift of the angle."""
        a = self.amplitude_a.value * complex(
            math.cos(self.phase_a.value), math.sin(self.phase_a.value)
        )
        phase = self.phase_b.value - self.order * shift_rad
        return a, self.amplitude_b.value * complex(math.cos(phase), math.sin(phase))

    def covariance(self, shift_rad: float = 0.0) -> FloatArray:
        """Return the covariance of the difference of both vectors."""
        a, b = self.vectors(shift_rad)
        total = _own(a, self.amplitude_a, self.phase_a, [p.in_a for p in self.common])
        total = total + _own(b, self.amplitude_b, self.phase_b, [p.in_b for p in self.common])
        for part in self.common:
            direction = unit_vector(b) * part.in_b - unit_vector(a) * part.in_a
            total = total + np.outer(direction, direction)
        return np.asarray(total)


def unit_vector(vector: complex) -> FloatArray:
    """Return the direction of a complex number."""
    size = abs(vector)
    return np.array([vector.real, vector.imag]) / size if size > 0.0 else np.zeros(2)


def _own(
    vector: complex, amplitude: Quantity, phase: Quantity, common: Sequence[float]
) -> FloatArray:
    """Return the covariance of one vector without the common parts."""
    along = max(0.0, amplitude.std**2 - math.fsum(part**2 for part in common))
    if not amplitude.value > _KNOWN_PHASE_SIGMA * amplitude.std:
        return amplitude.std**2 * np.eye(2)
    unit = unit_vector(vector)
    across = np.array([-unit[1], unit[0]])
    beside = (amplitude.value * phase.std) ** 2
    return np.asarray(along * np.outer(unit, unit) + beside * np.outer(across, across))
