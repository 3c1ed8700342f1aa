"""Samples that are left out, where a noise with a long memory needs their values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

__all__ = ["Bridges", "bridges"]


@dataclass(frozen=True, slots=True)
class _Bridge:
    """One run of samples that is left out, and the samples whose means are its ends."""

    out: slice
    before: NDArray[np.intp]
    after: NDArray[np.intp]
    share: FloatArray


@dataclass(frozen=True, slots=True)
class Bridges:
    """Straight lines over what is left out, as a linear map and its adjoint.

    Parameters
    ----------
    runs : tuple
        Runs of samples that are left out.

    Notes
    -----
    A straight line is what a random walk is expected to do between two of its values. These are
    known up to the noise beside it: means over as many samples as the walk needs to move by as
    much as their noise.
    """

    runs: tuple[_Bridge, ...]

    def cross(self, table: Any) -> Any:
        """Return a copy of columns, shape (n, k), with the gaps bridged."""
        whole = np.array(table, order="F")
        for run in self.runs:
            share = run.share.astype(whole.dtype)[:, None]
            first, last = table[run.before].mean(axis=0), table[run.after].mean(axis=0)
            whole[run.out] = (1.0 - share) * first + share * last
        return whole

    def adjoint(self, table: Any) -> None:
        """Give what lies on the bridges to their ends, in place; table has shape (n, k)."""
        given = []
        for run in self.runs:
            share = run.share.astype(table.dtype)[:, None]
            lying = table[run.out]
            first = np.sum((1.0 - share) * lying, axis=0) / len(run.before)
            last = np.sum(share * lying, axis=0) / len(run.after)
            given.append((run, first, last))
        for run, first, last in given:
            table[run.out] = 0.0
            table[run.before] += first
            table[run.after] += last


def bridges(valid: NDArray[np.bool_], reach: float) -> Bridges | None:
    """Return the bridges over the samples that are left out.

    Parameters
    ----------
    valid : ndarray of bool, shape (n,)
        Samples that enter.
    reach : float
        Samples on either side whose mean is an end, at least one.

    Returns
    -------
    Bridges or None
        None where all enter, or none does.
    """
    kept = np.flatnonzero(valid)
    if not len(kept) or len(kept) == len(valid):
        return None
    edges = np.flatnonzero(np.diff(np.concatenate([[True], valid, [True]]).astype(np.int8)))
    count = max(1, round(min(reach, float(len(kept)))))
    runs = []
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        place = int(np.searchsorted(kept, begin))
        before, after = kept[max(0, place - count) : place], kept[place : place + count]
        # beyond the ends of the record the nearest mean stands
        before, after = before if len(before) else after, after if len(after) else before
        share = (np.arange(begin, end) - begin + 1.0) / (end - begin + 1.0)
        runs.append(_Bridge(slice(begin, end), before, after, share))
    return Bridges(tuple(runs))
