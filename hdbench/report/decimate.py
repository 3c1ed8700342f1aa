"""Fewer points for the screen, with every peak kept."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from hdbench.records import FloatArray

__all__ = ["min_max"]


def min_max(x: FloatArray, y: FloatArray, bins: int = 600) -> tuple[FloatArray, FloatArray]:
    """Keep the smallest and the largest value of each of `bins` stretches.

    Examples
    --------
    >>> x = np.arange(8.0)
    >>> min_max(x, np.array([0.0, 3.0, 1.0, 1.0, 0.0, 0.0, -5.0, 0.0]), bins=2)
    (array([0., 1., 4., 6.]), array([ 0.,  3.,  0., -5.]))
    """
    if bins < 1 or x.shape != y.shape:
        raise ValueError(f"bins {bins!r} must be at least 1, shapes {x.shape} {y.shape} equal")
    if len(y) <= 2 * bins:
        return x, y
    edges = np.linspace(0, len(y), bins + 1).astype(np.intp)
    keep_x: list[float] = []
    keep_y: list[float] = []
    for start, stop in pairwise(edges.tolist()):
        part = y[start:stop]
        present = np.isfinite(part)
        if present.any():
            first, last = sorted((int(np.nanargmin(part)), int(np.nanargmax(part))))
            for i in (first,) if first == last else (first, last):
                keep_x.append(float(x[start + i]))
                keep_y.append(float(part[i]))
        if not present.all():
            keep_x.append(float(x[stop - 1]))
            keep_y.append(float("nan"))
    return np.array(keep_x), np.array(keep_y)
