"""Fault: a fault of the acquisition with its evidence, and the marks that samples get."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from hdbench.diagnosis.answer.records import DataFlag
from hdbench.records.trace import FloatArray, Trace

__all__ = [
    "ACCEPT_NATS",
    "TELL_NATS",
    "Entry",
    "Fault",
    "entry",
    "flag_runs",
    "flag_samples",
    "mask_runs",
    "normal_tail",
    "robust_std",
]

# evidence that a fault needs: as for causes, a Bayes factor of 3000
ACCEPT_NATS = 8.0
# names within this many nats are not told apart: a Bayes factor of 20
TELL_NATS = 3.0
# more stretches than this are told as one flag over all of them
_MANY = 20

Entry = dict[str, float | str | None]


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of the acquisition.

    Parameters
    ----------
    name : str
        Name of the catalogue.
    parameters : dict
        For each name ``value``, ``std`` (None where not known) and ``unit``.
    samples : int
        Samples that it touches.
    from_s, to_s : float
        Time of the first and of the last of them, s.
    evidence_nats : float
        Log likelihood ratio less half a log of the samples for each parameter.
    false_alarm_probability : float
        Probability of such evidence anywhere on a record without the fault, in [0, 1].
    channels_used : tuple of str
        Channels that speak for it.
    shape : dict of str to float
        Shape parameters of the catalogue, for the model file.
    group, rivals : tuple of str
        Other names that these data cannot tell from it, or hardly.
    undone : Trace or None
        Trace with every fault taken out but this one; None where nothing was taken out.
    masked : ndarray of bool, shape (n,), or None
        Samples that are left out for it.
    domain : str
        Axis on which it is plainest.
    """

    name: str
    parameters: Mapping[str, Entry]
    samples: int
    from_s: float
    to_s: float
    evidence_nats: float
    false_alarm_probability: float
    channels_used: tuple[str, ...]
    shape: Mapping[str, float] = field(default_factory=dict)
    group: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()
    undone: Trace | None = None
    masked: NDArray[np.bool_] | None = None
    domain: str = "time"

    def flag(self) -> DataFlag:
        """Return its samples as a flag."""
        return DataFlag(self.name, self.from_s, self.to_s, self.samples)


def entry(value: float, std: float | None, unit: str) -> Entry:
    """Return a parameter as the contract writes it."""
    return {"value": float(value), "std": None if std is None else float(std), "unit": unit}


def normal_tail(sigmas: float, trials: float, parameters: int, samples: int) -> tuple[float, float]:
    """Return evidence and false-alarm probability of the largest of many normal statistics."""
    nats = 0.5 * sigmas**2 - 0.5 * parameters * float(np.log(samples))
    log_chance = float(np.log(2.0 * trials) + log_ndtr(-abs(sigmas)))
    return nats, float(np.exp(min(0.0, log_chance)))


def robust_std(values: FloatArray) -> float:
    """Return half the width that holds 68.27 %: the standard deviation of normal values."""
    return float(np.quantile(np.abs(values - np.median(values)), 0.6827)) if len(values) else 0.0


def mask_runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def flag_samples(
    name: str, time_s: FloatArray, mask: NDArray[np.bool_], detail: str = ""
) -> tuple[DataFlag, ...]:
    """Return one flag from the first to the last marked sample; none where none is marked."""
    at = np.flatnonzero(mask)
    if not len(at):
        return ()
    return (DataFlag(name, float(time_s[at[0]]), float(time_s[at[-1]]), len(at), detail),)


def flag_runs(name: str, time_s: FloatArray, mask: NDArray[np.bool_]) -> tuple[DataFlag, ...]:
    """Return one flag for each run of marked samples, one over all where there are many."""
    runs = mask_runs(mask)
    if len(runs) > _MANY:
        return flag_samples(name, time_s, mask)
    return tuple(DataFlag(name, float(time_s[a]), float(time_s[b]), b - a + 1) for a, b in runs)
