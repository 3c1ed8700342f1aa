"""Samples that are left out, where a noise with a long memory needs their values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

__all__ = ["Bridges", "bridges"]


@dataclass(frozen=True, slots=True)
class Bridges:
    """Straight lines over what is left out, as a linear map and its adjoint.

    Parameters
    ----------
    out : ndarray of int, shape (m,)
        Samples that are left out.
    before, after : ndarray of int, shape (m,)
        The next samples on both sides that are not; the same one at an end of the record.
    share : ndarray, shape (m,)
        Weight of the later one.

    Notes
    -----
    A straight line is what a random walk is expected to do between two of its values.
    """

    out: NDArray[np.intp]
    before: NDArray[np.intp]
    after: NDArray[np.intp]
    share: FloatArray

    def cross(self, table: Any) -> Any:
        """Return a copy of columns, shape (n, k), with the gaps bridged."""
        whole = np.array(table, order="F")
        share = self.share.astype(whole.dtype)[:, None]
        whole[self.out] = (1.0 - share) * whole[self.before] + share * whole[self.after]
        return whole

    def adjoint(self, table: Any) -> None:
        """Give what lies on the bridges to their ends, in place; table has shape (n, k)."""
        share = self.share.astype(table.dtype)[:, None]
        lying = table[self.out]
        table[self.out] = 0.0
        np.add.at(table, self.before, (1.0 - share) * lying)
        np.add.at(table, self.after, share * lying)


def bridges(valid: NDArray[np.bool_]) -> Bridges | None:
    """Return the bridges over the samples that are left out.

    Parameters
    ----------
    valid : ndarray of bool, shape (n,)
        Samples that enter.

    Returns
    -------
    Bridges or None
        None where all enter, or none does.
    """
    kept, out = np.flatnonzero(valid), np.flatnonzero(~valid)
    if not len(kept) or not len(out):
        return None
    place = np.searchsorted(kept, out)
    before = kept[np.maximum(place - 1, 0)]
    after = kept[np.minimum(place, len(kept) - 1)]
    # beyond the ends of the record the nearest sample stands
    before, after = np.where(place == 0, after, before), np.where(place == len(kept), before, after)
    share = (out - before) / np.maximum(after - before, 1)
    return Bridges(out, before, after, np.clip(share, 0.0, 1.0))
