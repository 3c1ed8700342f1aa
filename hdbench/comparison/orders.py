"""Orders as vectors: amplitude and phase of two runs."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdbench.comparison.score import SharedPart, own_part, region
from hdbench.estimation.harmonics import combine
from hdbench.records import FloatArray, Quantity

# starts of the search for the shift: the distance is a sum of cosines of it, of the orders at most
_STARTS_PER_PERIOD = 24


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
    common : tuple of SharedPart
        Parts of the amplitudes' uncertainty from one source, such as one gain.
    """

    order: float
    amplitude_a: Quantity
    amplitude_b: Quantity
    phase_a: Quantity
    phase_b: Quantity
    common: tuple[SharedPart, ...] = ()

    def vectors(self, shift_rad: float = 0.0) -> tuple[complex, complex]:
        """Return both as complex amplitudes, the second turned back by a shift of the angle."""
        a = cmath.rect(self.amplitude_a.value, self.phase_a.value)
        phase = self.phase_b.value - self.order * shift_rad
        return a, cmath.rect(self.amplitude_b.value, phase)

    def covariance(self, shift_rad: float = 0.0) -> FloatArray:
        """Return the covariance of the difference of both vectors."""
        a, b = self.vectors(shift_rad)
        total = _own(a, self.amplitude_a, self.phase_a, [p.in_a for p in self.common])
        total = total + _own(b, self.amplitude_b, self.phase_b, [p.in_b for p in self.common])
        for part in self.common:
            direction = _unit_vector(b) * part.in_b - _unit_vector(a) * part.in_a
            total = total + np.outer(direction, direction)
        return np.asarray(total)


def _unit_vector(vector: complex) -> FloatArray:
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
    unit = _unit_vector(vector)
    across = np.array([-unit[1], unit[0]])
    beside = (amplitude.value * phase.std) ** 2
    return np.asarray(along * np.outer(unit, unit) + beside * np.outer(across, across))


@dataclass(frozen=True, slots=True)
class Pattern:
    """How the orders of two runs compare as vectors.

    Parameters
    ----------
    same_origin : bool
        Whether the angle has one origin in both runs, as the user says.
    shift_rad : float
        Shift of the angle taken off the second run, rad; 0 with one origin.
    pairs : tuple of OrderPair
        The orders.
    scores : tuple of float or None
        Each order's vector difference over its confidence region; above 1 it has moved. Without
        one origin a single order says nothing beyond its amplitude, and these hold after the shift.
    score : float or None
        All orders together; None where a single order can be turned at will.
    """

    same_origin: bool
    shift_rad: float
    pairs: tuple[OrderPair, ...]
    scores: tuple[float | None, ...]
    score: float | None

    @property
    def moved(self) -> bool | None:
        """Whether it moved; None where that cannot be told."""
        return None if self.score is None else not self.score <= 1.0

    def to_dict(self) -> dict[str, Any]:
        """Return it as ``--json`` prints it."""
        return {
            "same_origin": self.same_origin,
            "shift_rad": self.shift_rad,
            "score": self.score,
            "moved": self.moved,
            "orders": [
                {
                    "order": pair.order,
                    "a": _polar(pair.amplitude_a, pair.phase_a),
                    "b": _polar(pair.amplitude_b, pair.phase_b),
                    "difference": _difference(pair, self.shift_rad),
                    "score": score,
                }
                for pair, score in zip(self.pairs, self.scores, strict=True)
            ],
        }


def _polar(amplitude: Quantity, phase: Quantity) -> dict[str, Any]:
    return {"amplitude_nm": amplitude.to_dict(), "phase_rad": phase.to_dict()}


def _difference(pair: OrderPair, shift_rad: float) -> dict[str, Any]:
    a, b = pair.vectors(shift_rad)
    step = b - a
    unit = _unit_vector(step)
    std = math.sqrt(max(0.0, float(unit @ pair.covariance(shift_rad) @ unit)))
    return {
        "cosine_nm": step.real,
        "sine_nm": step.imag,
        "amplitude_nm": {"value": abs(step), "std": std, "dof": _dof([pair])},
        "phase_rad": math.atan2(step.imag, step.real),
    }


def _dof(pairs: Sequence[OrderPair]) -> float | None:
    """Return the effective degrees of freedom of all parts of the differences."""
    parts: list[tuple[float, float | None]] = []
    for pair in pairs:
        commons = [[(p.in_a, p.dof) for p in pair.common], [(p.in_b, p.dof) for p in pair.common]]
        parts += [
            own_part(pair.amplitude_a, commons[0]),
            own_part(pair.amplitude_b, commons[1]),
            (pair.amplitude_a.value * pair.phase_a.std, pair.phase_a.dof),
            (pair.amplitude_b.value * pair.phase_b.std, pair.phase_b.dof),
            *((abs(p.in_b - p.in_a), p.dof) for p in pair.common),
        ]
    return combine(*parts)[1]


def compare_pattern(
    pairs: Sequence[OrderPair], same_origin: bool, confidence: float
) -> Pattern | None:
    r"""Compare the orders of two runs as vectors.

    Notes
    -----
    An angle counted from wherever a run began turns every vector by its order times one unknown
    shift :math:`\varphi`: :math:`B_k e^{-j k \varphi}`. Without one origin the shift that brings
    both patterns closest together is taken off, and their distance is held against one degree of
    freedom less. With one order alone nothing is left but its amplitude.
    """
    if not pairs:
        return None
    shift = 0.0 if same_origin else _best_shift(pairs)
    dof = _dof(pairs)
    scores = tuple(_score([pair], shift, 2, confidence, dof) for pair in pairs)
    free = 2 * len(pairs) - (0 if same_origin else 1)
    joint = None
    if same_origin or len(pairs) > 1:
        joint = _score(pairs, shift, free, confidence, dof)
    return Pattern(same_origin, shift, tuple(pairs), scores, joint)


def _statistic(pairs: Sequence[OrderPair], shift: float) -> float:
    total = 0.0
    for pair in pairs:
        a, b = pair.vectors(shift)
        step = np.array([(b - a).real, (b - a).imag])
        try:
            total += float(step @ np.linalg.solve(pair.covariance(shift), step))
        except np.linalg.LinAlgError:
            return math.nan
    return total


def _best_shift(pairs: Sequence[OrderPair]) -> float:
    """Return the shift of least distance, rad, in [-pi, pi]."""
    from scipy.optimize import minimize_scalar

    highest = max(abs(pair.order) for pair in pairs)
    count = math.ceil(_STARTS_PER_PERIOD * max(1.0, highest))
    grid = np.arange(count) * (2.0 * math.pi / count)
    values = [_statistic(pairs, float(shift)) for shift in grid]
    if not all(math.isfinite(value) for value in values):
        return 0.0
    at, step = float(grid[int(np.argmin(values))]), 2.0 * math.pi / count
    found = minimize_scalar(
        lambda shift: _statistic(pairs, float(shift)),
        bounds=(at - step, at + step),
        method="bounded",
        options={"xatol": 1e-9},
    )
    return math.remainder(float(found.x), 2.0 * math.pi)


def _score(
    pairs: Sequence[OrderPair], shift: float, free: int, confidence: float, dof: float | None
) -> float | None:
    """Return how far the differences are out of their confidence region."""
    statistic = _statistic(pairs, shift)
    if not math.isfinite(statistic):
        return None
    return math.sqrt(max(0.0, statistic) / region(free, confidence, dof))
