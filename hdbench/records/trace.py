"""Sampled channels of one dynamic run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# longest first: `_rad_s` ends in `_s` too
_UNITS = {
    "_rad_s2": "rad/s^2",
    "_rad_s": "rad/s",
    "_rad": "rad",
    "_nm": "N m",
    "_hz": "Hz",
    "_kg": "kg",
    "_v": "V",
    "_a": "A",
    "_c": "degC",
    "_s": "s",
    "_count": "1",
}


def unit_of_column(name: str) -> str:
    """Return the unit that a column's name ends in; empty where it ends in none."""
    return next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), "")


@dataclass(frozen=True, slots=True)
class Trace:
    """Sampled channels over time, each of shape (n_samples,).

    Parameters
    ----------
    columns : mapping of str to ndarray
        Channel name (contract section 3) to samples, float64, in file order. A lost sample is
        NaN in every channel but `time_s`. Columns that the contract does not name are kept.
    source : str
        Where the trace came from; used in error messages and provenance.
    metadata : mapping
        What is known beside the samples (run id, gain used, sample period asked for).
    """

    columns: Mapping[str, FloatArray]
    source: str = "<memory>"
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns["time_s"])

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]

    @property
    def time_s(self) -> FloatArray:
        """Time, s, strictly increasing."""
        return self.columns["time_s"]

    def valid(self, *names: str) -> NDArray[np.bool_]:
        """Return which samples are present (finite) in all of `names`.

        Parameters
        ----------
        *names : str
            Channel names; with none, all channels.

        Returns
        -------
        ndarray of bool, shape (n_samples,)
        """
        finite = [np.isfinite(self.columns[name]) for name in names or self.columns]
        return np.asarray(np.all(finite, axis=0))

    def with_columns(self, **columns: FloatArray) -> Trace:
        """Return a copy with `columns` added or replaced."""
        return Trace({**self.columns, **columns}, self.source, self.metadata)
