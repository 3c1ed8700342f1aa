"""The part of a record that is diagnosed, where it is not the whole."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hdbench.errors import DataError
from hdbench.records import Trace

__all__ = ["MOST_SAMPLES", "Part", "part_of"]

MOST_SAMPLES = 600_000
"""Samples of one diagnosis at most: ten minutes at 1 kHz, the longest records of the blind
benchmark. Memory grows by some 4 kB a sample."""


@dataclass(frozen=True, slots=True)
class Part:
    """Which part of a record is diagnosed.

    Parameters
    ----------
    from_s, to_s : float
        Its first and last time stamp, s.
    samples, of_samples : int
        How many it holds, and the whole record.
    cut : bool
        Whether it ends where it does because one diagnosis takes no more samples.
    """

    from_s: float
    to_s: float
    samples: int
    of_samples: int
    cut: bool

    def to_dict(self) -> dict[str, Any]:
        """Return it as a JSON object."""
        return asdict(self)


def part_of(
    trace: Trace,
    from_s: float | None = None,
    to_s: float | None = None,
    *,
    most: int = MOST_SAMPLES,
) -> tuple[Trace, Part | None]:
    """Return the part of a record to diagnose."""
    time_s = trace.time_s
    begin = 0 if from_s is None else int(np.searchsorted(time_s, from_s, side="left"))
    end = len(trace) if to_s is None else int(np.searchsorted(time_s, to_s, side="right"))
    if end <= begin:
        raise DataError(
            f"no sample from {'the start' if from_s is None else f'{from_s:g} s'} to "
            f"{'the end' if to_s is None else f'{to_s:g} s'}; "
            f"the record runs from {time_s[0]:g} to {time_s[-1]:g} s",
            where=trace.source,
            fix="name times of the record's own clock, the earlier one first",
        )
    kept = min(end - begin, most)
    if kept == len(trace):
        return trace, None
    columns = {name: column[begin : begin + kept] for name, column in trace.columns.items()}
    held = Trace(columns, trace.source, trace.metadata)
    ends = float(held.time_s[0]), float(held.time_s[-1])
    return held, Part(*ends, kept, len(trace), kept < end - begin)
