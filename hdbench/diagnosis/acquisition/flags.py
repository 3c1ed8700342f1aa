"""Stretches of doubtful samples, and runs in masks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.answer.records import DataFlag
from hdbench.records.trace import FloatArray

__all__ = ["DataFlag", "flag_runs", "flag_samples", "mask_runs"]

# more stretches than this are told as one flag over all of them
MANY = 20


def mask_runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last index of each run of True.

    Parameters
    ----------
    mask : ndarray of bool, shape (n,)
        Mask.

    Returns
    -------
    list of (int, int)
        In order; empty where nothing is True.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def flag_samples(
    name: str, time_s: FloatArray, mask: NDArray[np.bool_], detail: str = ""
) -> list[DataFlag]:
    """Return one flag for the marked samples, none where there are none.

    Parameters
    ----------
    name : str
        Name of the fault.
    time_s : ndarray, shape (n_samples,)
        Time, s.
    mask : ndarray of bool, shape (n_samples,)
        Marked samples.
    detail : str
        One sentence for a person.

    Returns
    -------
    list of DataFlag
        From the first to the last of them.
    """
    at = np.flatnonzero(mask)
    if not len(at):
        return []
    return [DataFlag(name, float(time_s[at[0]]), float(time_s[at[-1]]), len(at), detail)]


def flag_runs(name: str, time_s: FloatArray, mask: NDArray[np.bool_]) -> list[DataFlag]:
    """Return one flag for each run of marked samples, or a single one over more than twenty.

    Parameters
    ----------
    name : str
        Name of the fault.
    time_s : ndarray, shape (n_samples,)
        Time, s.
    mask : ndarray of bool, shape (n_samples,)
        Marked samples.

    Returns
    -------
    list of DataFlag
    """
    runs = mask_runs(mask)
    if len(runs) > MANY:
        return flag_samples(name, time_s, mask)
    return [DataFlag(name, float(time_s[a]), float(time_s[b]), b - a + 1) for a, b in runs]
