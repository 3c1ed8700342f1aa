"""Shapes at which a family of the catalogue is tried: as few as leave no member out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from itertools import product
from typing import Any

import numpy as np

from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.term import WIDE, Term
from hdbench.model import Cause, Motion, Parameter, shape_bounds
from hdbench.records.trace import FloatArray

# points over special parameters, and over any other by how many the cause has; a resonance is
# some 8 % wide, and one that lies between two of the grid, a tenth apart, is seen by both
_SPECIAL = {
    "position_rad": 32,
    "width_turns": 2,
    "resonance_hz": 32,
    "damping": 1,
    "delay_s": 6,
    "sharpness": 4,
    "knee_ratio": 3,
}
_POINTS = {1: 12, 2: 6, 3: 4}
# orders of the drive's lobes, at which a cause with further shapes is tried
_ORDERS = (1.0, 2.0, 4.0, 6.0)
# samples on which members are compared: enough for every slow shape
_THIN = 4000
# a shape is left out where one that is kept has this share of its energy in common; less, until a
# family is no larger than this
_ALIKE = (0.9, 0.8, 0.65, 0.5)
_MOST = 16


def shape_grid(cause: Cause, motion: Motion) -> list[Mapping[str, float]]:
    """Return a grid over the shapes of a cause; one empty mapping for a cause without any."""
    bounds = shape_bounds(cause, motion)
    count = _POINTS.get(len(cause.shape), 3)
    axes = [_axis(p, bounds[p.name], _SPECIAL.get(p.name, count)) for p in cause.shape]
    names = [p.name for p in cause.shape]
    return [dict(zip(names, map(float, point), strict=True)) for point in product(*axes)]


def _axis(parameter: Parameter, bands: tuple[tuple[float, float], ...], count: int) -> FloatArray:
    points = []
    for low, high in bands:
        if count == 1:
            points.append(np.array([float(np.sqrt(low * high)) if low > 0.0 else low]))
        elif parameter.name == "order":
            points.append(np.array([order for order in _ORDERS if low <= order <= high]))
        elif low > 0.0 and high > WIDE * low:
            points.append(np.geomspace(low, high, count))
        else:
            points.append(np.linspace(low, high, count))
    return np.concatenate(points) if points else np.zeros(0)


def chosen_shapes(cause: Cause, record: Record) -> list[Term]:
    """Return members of a family so that every point of a fine grid is like one of them.

    Members are compared on some thousand samples, the baseline projected out. What follows the
    motor, and a shift of the whole signal, is too fast for that and keeps its grid.
    """
    grid = shape_grid(cause, record.motion)
    if len(grid) <= 1 or cause.locked_to == "motor" or "delay_s" in grid[0]:
        return [Term(cause, shape) for shape in grid]
    step = max(1, len(record) // _THIN)
    motion, seen = _thinned(record.motion, step), record.valid[::step]
    base = np.linalg.qr(record.columns[::step])[0]
    shapes: list[tuple[Term, FloatArray]] = []
    for shape in grid:
        columns = np.where(seen[:, None], cause.columns(motion, shape), 0.0)
        if not np.isfinite(columns).all():
            return []
        before = float(np.sum(columns**2))
        columns = columns - base @ (base.T @ columns)
        # what the baseline explains but for rounding shows nothing
        if float(np.sum(columns**2)) > 1e-6 * before:
            shapes.append((Term(cause, shape), np.linalg.qr(columns)[0]))
    kept: list[Term] = []
    for alike in _ALIKE:
        kept = _unlike(shapes, alike)
        if len(kept) <= _MOST:
            break
    return kept


def _thinned(motion: Motion, step: int) -> Motion:
    """Return every `step`-th sample of a motion; a stretch starts where one left out started it."""
    changes: dict[str, Any] = {
        field.name: value[::step]
        for field in fields(motion)
        if isinstance(value := getattr(motion, field.name), np.ndarray)
    }
    if motion.starts is not None:
        edges = np.arange(0, len(motion), step)
        changes["starts"] = np.logical_or.reduceat(motion.starts, edges)
    return replace(motion, **changes)


def _unlike(shapes: list[tuple[Term, FloatArray]], alike: float) -> list[Term]:
    """Return the terms of which none has more in common with one before it."""
    kept: list[tuple[Term, FloatArray]] = []
    for term, basis in shapes:
        like = (float(np.sum((b.T @ basis) ** 2)) / basis.shape[1] for _, b in kept)
        if max(like, default=0.0) < alike:
            kept.append((term, basis))
    return [term for term, _ in kept]
