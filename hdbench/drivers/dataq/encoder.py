"""An encoder on a counter that knows no direction: the tacho's sign gives it."""

from __future__ import annotations

import numpy as np

from hdbench.records.trace import FloatArray

__all__ = ["WRAP", "SignedCounter"]

_COUNTER_WRAP = 2**16
# what the driver gives out, like a 32-bit quadrature counter
WRAP = 2**32


class SignedCounter:
    """Turns a counter's edges into a position.

    Parameters
    ----------
    counts_per_edge : int
        Encoder counts between two edges that are counted.

    Notes
    -----
    position(k) = position(k - 1) + sign(tacho(k)) * edges(k) * counts_per_edge, where edges(k) came
    since sample k - 1, modulo 2**16. Near a reversal an edge or two may get the other sign; the
    position is in the middle of what an edge leaves open, half of `counts_per_edge`.
    """

    def __init__(self, counts_per_edge: int) -> None:
        self._counts_per_edge = counts_per_edge
        self._last: int | None = None
        self._position = counts_per_edge // 2

    def __call__(self, edges: FloatArray, tacho: FloatArray) -> FloatArray:
        """Return the position at the next samples."""
        if not len(edges):
            return edges
        counts = edges.astype(np.int64)
        first = int(counts[0]) if self._last is None else self._last
        steps = np.diff(counts, prepend=first) % _COUNTER_WRAP
        moved = np.where(tacho < 0.0, -steps, steps) * self._counts_per_edge
        positions = self._position + np.cumsum(moved)
        self._last, self._position = int(counts[-1]), int(positions[-1])
        wrapped: FloatArray = (positions % WRAP).astype(np.float64)
        return wrapped
