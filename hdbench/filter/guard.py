"""Torque samples that a sensor or converter cannot have measured: saturated or stuck."""

from __future__ import annotations

import numpy as np

from hdbench.filter.layout import GATED, MISSING, UNRESOLVED
from hdbench.filter.model import FilterModel
from hdbench.records import FloatArray

__all__ = ["FLAG_BITS", "GUARD_STATES", "SATURATED", "STUCK", "guard_torque"]

SATURATED, STUCK = 8, 16
"""Bits of a sample's flag, beside those of `hdbench.filter.layout`."""

FLAG_BITS = {
    "missing": MISSING,
    "gated": GATED,
    "unresolved": UNRESOLVED,
    "saturated": SATURATED,
    "stuck": STUCK,
}
"""Every bit of a sample's flag by its name."""

GUARD_STATES = 2
"""Numbers that the guard keeps between calls: last torque, and how often it came in a row."""


def guard_torque(
    model: FilterModel, torque_nm: FloatArray, state: FloatArray
) -> tuple[FloatArray, np.ndarray[tuple[int], np.dtype[np.uint8]]]:
    """Return the torque with impossible samples missing, and why.

    Notes
    -----
    Causal: a run of equal torques is flagged from its `stuck_samples`-th sample on, so that blocks
    of any split give the same answer. A missing sample ends a run.
    """
    flags = np.zeros(torque_nm.size, dtype=np.uint8)
    if model.torque_limit_nm is not None:
        flags[np.abs(torque_nm) >= model.torque_limit_nm] |= SATURATED | MISSING
    if model.stuck_samples is not None and torque_nm.size:
        flags[_run_lengths(torque_nm, state) >= model.stuck_samples] |= STUCK | MISSING
    return (np.where(flags != 0, np.nan, torque_nm) if flags.any() else torque_nm), flags


def _run_lengths(torque_nm: FloatArray, state: FloatArray) -> FloatArray:
    """Return how many equal torques end at each sample; advance the state."""
    new = np.ones(torque_nm.size, dtype=bool)
    new[1:] = torque_nm[1:] != torque_nm[:-1]
    carried = state[1] if state[1] > 0.0 and torque_nm[0] == state[0] else 0.0
    index = np.arange(torque_nm.size)
    first = np.maximum.accumulate(np.where(new, index, 0))
    length: FloatArray = (index - first + 1).astype(np.float64)
    length = length + np.where(first == 0, carried, 0.0)
    known = bool(np.isfinite(torque_nm[-1]))
    state[0] = torque_nm[-1] if known else 0.0
    state[1] = length[-1] if known else 0.0
    return length
