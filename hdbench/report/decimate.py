"""Fewer points for the screen, with every peak kept."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from hdbench.records import FloatArray

__all__ = ["min_max"]


def min_max(x: FloatArray, y: FloatArray, bins: int = 600) -> tuple[FloatArray, FloatArray]:
    """Keep the smallest and the largest value of each of `bins` stretches.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Abscissa, increasing.
    y : ndarray, shape (n,)
        Values; NaN where a sample is missing.
    bins : int
        How many stretches of equally many samples, at least 1; one pixel column each is enough.

    Returns
    -------
    x, y : ndarray, shape (m,)
        At most ``3 * bins`` points in the order of `x`; unchanged where `y` has no more than
        ``2 * bins``. A stretch in which a sample is missing ends with a NaN, so that a line drawn
        through the points is broken there.

    Raises
    ------
    ValueError
        If `bins` is below 1 or the shapes differ.

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
