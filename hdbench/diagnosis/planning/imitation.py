"""How well one effect can imitate another, with its own shape free."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.noise.whitened import orthonormal
from hdbench.diagnosis.planning.lines import Bands, LineSpectra, holds
from hdbench.diagnosis.planning.signatures import (
    Effect,
    line_key,
    shape_axes,
    shape_grid,
)
from hdbench.diagnosis.planning.sketch import Sketch
from hdbench.model import Cause, shape_bounds
from hdbench.records.trace import FloatArray

__all__ = ["Imitator", "Target", "make_target"]

# a column whose whitened size falls below this share after the baseline was projected out is the
# rounding error of that projection
_ROUNDING = 1e-10
# a pair that a grid point leaves above this is told apart whatever the shape in between; 0.15 is
# more than refinement has gained anywhere on the built-in protocols
_SURELY_APART = 0.6
# golden sections of each shape parameter; 12 of them narrow a grid step to 1/320, 6 to 1/18 for
# a cause that needs every sample of the motion
_SECTIONS, _FEW_SECTIONS = 12, 6
_GOLDEN = 0.6180339887498949


@dataclass(frozen=True, slots=True)
class Target:
    """An effect to be imitated.

    Parameters
    ----------
    effect : Effect
        Effect with its shape.
    left : ndarray, shape (m, k)
        Its whitened columns less the baseline, scaled to a total square of 1.
    energy : float
        Total square of the whitened columns, per (N m)^2 of their coefficients.
    share : float
        Share of that square which the baseline cannot imitate.
    """

    effect: Effect
    left: FloatArray
    energy: float
    share: float


def make_target(effect: Effect, sketch: Sketch, columns: FloatArray) -> Target:
    """Return an effect as a target.

    Parameters
    ----------
    effect : Effect
        Effect.
    sketch : Sketch
        Sketch of the motion.
    columns : ndarray, shape (m, k)
        Its whitened columns.

    Returns
    -------
    Target
    """
    energy = float(np.sum(columns**2))
    left = sketch.project(columns)
    rest = float(np.sum(left**2))
    seen = energy > 0.0 and rest > _ROUNDING * energy
    scaled = left / np.sqrt(rest) if seen else np.zeros_like(left)
    return Target(effect, scaled, energy, rest / energy if seen else 0.0)


@dataclass(frozen=True, slots=True)
class Imitator:
    """A cause whose shape is free, on one sketch.

    Parameters
    ----------
    cause : Cause
        Cause.
    sketch : Sketch
        Sketch.
    remembers : bool
        Whether the cause needs the samples between the rows.
    spectra : LineSpectra
        Spectra of the targets.
    refine : bool
        Whether shapes between the points of a grid are looked for.
    """

    cause: Cause
    sketch: Sketch
    remembers: bool
    spectra: LineSpectra
    refine: bool = True

    def basis(self, shape: Mapping[str, float]) -> FloatArray:
        """Return the span of its columns beside the baseline, shape (m, k)."""
        columns = self.sketch.columns(self.cause, dict(shape), remembers=self.remembers)
        left = self.sketch.project(columns)
        size = np.sqrt(np.sum(columns**2, axis=0))
        seen = np.sqrt(np.sum(left**2, axis=0)) > np.sqrt(_ROUNDING) * size
        return orthonormal(left[:, seen])

    def imitated(self, shape: Mapping[str, float], targets: FloatArray) -> FloatArray:
        """Return the square of the targets' columns that it imitates, shape (n_columns,)."""
        return np.asarray(np.sum((self.basis(shape).T @ targets) ** 2, axis=0))

    def shares_left(
        self, targets: tuple[Target, ...], start: Mapping[str, float] | None
    ) -> list[tuple[float, dict[str, float]]]:
        """Return what it cannot imitate of each target, and with which shape it comes nearest.

        Parameters
        ----------
        targets : tuple of Target
            Targets.
        start : mapping or None
            A shape that is tried beside the grid.

        Returns
        -------
        list of (float, dict)
            sin^2 in [0, 1] and shape.
        """
        if not targets:
            return []
        if line_key(self.cause) is not None:
            return [self._nearest_line(target, start) for target in targets]
        axes = shape_axes(self.cause, self.sketch.motion, coarse=self.remembers)
        shapes = shape_grid(axes)
        if start is not None:
            shapes.append(dict(start))
        stacked = np.hstack([target.left for target in targets])
        ends = np.cumsum([0, *(target.left.shape[1] for target in targets)])
        best = [(1.0, dict(start or {})) for _ in targets]
        for shape in shapes:
            squares = self.imitated(shape, stacked)
            for index in range(len(targets)):
                left = 1.0 - float(np.sum(squares[ends[index] : ends[index + 1]]))
                if left < best[index][0]:
                    best[index] = (left, shape)
        return [
            self._refined(target.left, found, axes)
            for target, found in zip(targets, best, strict=True)
        ]

    def _left(self, shape: Mapping[str, float], target: FloatArray) -> float:
        return float(np.clip(1.0 - np.sum(self.imitated(shape, target)), 0.0, 1.0))

    def _refined(
        self,
        target: FloatArray,
        found: tuple[float, dict[str, float]],
        axes: Mapping[str, FloatArray],
    ) -> tuple[float, dict[str, float]]:
        """Return the best shape between the neighbours of a grid point."""
        left, shape = max(0.0, found[0]), found[1]
        if left > _SURELY_APART or not self.refine:
            return left, shape
        for name, axis in axes.items():
            if len(axis) < 2:
                continue
            place = int(np.argmin(np.abs(axis - shape[name])))
            low = float(axis[max(place - 1, 0)])
            high = float(axis[min(place + 1, len(axis) - 1)])
            tried = self._golden(target, shape, name, (low, high))
            if tried[0] < left:
                left, shape = tried
        return left, shape

    def _golden(
        self, target: FloatArray, shape: dict[str, float], name: str, ends: tuple[float, float]
    ) -> tuple[float, dict[str, float]]:
        """Return the best value of one shape parameter by golden sections."""
        low, high = ends

        def at(value: float) -> float:
            return self._left({**shape, name: value}, target)

        a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        at_a, at_b = at(a), at(b)
        for _ in range(_FEW_SECTIONS if self.remembers else _SECTIONS):
            if at_a <= at_b:
                high, b, at_b = b, a, at_a
                a = high - _GOLDEN * (high - low)
                at_a = at(a)
            else:
                low, a, at_a = a, b, at_b
                b = low + _GOLDEN * (high - low)
                at_b = at(b)
        value, left = (a, at_a) if at_a <= at_b else (b, at_b)
        return left, {**shape, name: value}

    def _nearest_line(
        self, target: Target, start: Mapping[str, float] | None
    ) -> tuple[float, dict[str, float]]:
        """Return the nearest line: peaks of the target's spectrum, refined within their cells."""
        key = str(line_key(self.cause))
        bands = shape_bounds(self.cause, self.sketch.motion)[key]
        cell = self.spectra.cell(key)
        places = self.spectra.peaks(target.effect.name, target.left, key, bands, self._harmonics())
        places += _named_places(target.effect.shape, key, bands)
        if start is not None:
            places.append(start[key])
        best = (1.0, dict(start or {key: bands[0][0] if bands else 0.0}))
        for place in places:
            left = self._left({key: place}, target.left)
            if left <= _SURELY_APART:
                ends = (place - 0.5 * cell, place + 0.5 * cell)
                inside = _clipped(ends, place, bands)
                left, shape = min(
                    (left, {key: place}),
                    self._golden(target.left, {key: place}, key, inside),
                    key=lambda found: found[0],
                )
            else:
                shape = {key: place}
            if left < best[0]:
                best = (left, shape)
        return best

    def _harmonics(self) -> range:
        """Return which harmonics of its place the cause has: one for every pair of columns."""
        return range(1, max(1, len(self.cause.linear) // 2) + 1)


def _named_places(shape: Mapping[str, float], key: str, bands: Bands) -> list[float]:
    """Return the place of the effect itself where the line may lie there."""
    return [shape[key]] if key in shape and holds(bands, shape[key]) else []


def _clipped(ends: tuple[float, float], place: float, bands: Bands) -> tuple[float, float]:
    """Return the ends cut to the band that holds a place."""
    for low, high in bands:
        if low <= place <= high:
            return max(low, ends[0]), min(high, ends[1])
    return place, place
