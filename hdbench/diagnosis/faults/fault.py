"""Fault of the acquisition with its evidence, and what an inspection of the channels found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.answer.result import DataFlag
from hdbench.diagnosis.faults.scatter import mask_runs
from hdbench.records.trace import FloatArray, Trace

__all__ = ["Fault", "Inspected", "entry", "fault_over", "flag_runs", "flag_samples"]

# more stretches than this are told as one flag over all of them
_MANY = 20

_Entry = dict[str, float | str | None]


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
        Gain of the log likelihood less its price.
    false_alarm_probability : float
        Probability of such evidence on a record without the fault, in [0, 1].
    shape : dict of str to float
        Shape parameters of the catalogue, for the model file.
    group : tuple of str
        Other names that these data cannot tell from it.
    undone : Trace or None
        Trace with every fault taken out but this one; None where nothing was taken out.
    masked : ndarray of bool, shape (n,), or None
        Samples that are left out for it.
    domain : str
        Axis on which it is plainest.
    """

    name: str
    parameters: Mapping[str, _Entry]
    samples: int
    from_s: float
    to_s: float
    evidence_nats: float
    false_alarm_probability: float
    shape: Mapping[str, float] = field(default_factory=dict)
    group: tuple[str, ...] = ()
    undone: Trace | None = None
    masked: NDArray[np.bool_] | None = None
    domain: str = "time"

    def flag(self) -> DataFlag:
        """Return its samples as a flag."""
        return DataFlag(self.name, self.from_s, self.to_s, self.samples)


@dataclass(frozen=True, slots=True)
class Inspected:
    """A trace after its channels were inspected.

    Parameters
    ----------
    trace : Trace
        Channels as the rest of the diagnosis sees them: what can be trusted, named faults of
        angle, tacho and clock taken out.
    masked : ndarray of bool, shape (n,)
        Samples that take no part.
    left_out : tuple of (str, int)
        Why samples take no part, and how many.
    flags : tuple of DataFlag
        Doubtful samples, those of the faults among them.
    faults : tuple of Fault
        Named faults.
    reason : str
        Why nothing can be said, with the margin; empty where something can.
    derived : tuple of (str, str)
        Channels that were made of another one, and of which.
    """

    trace: Trace
    masked: NDArray[np.bool_]
    left_out: tuple[tuple[str, int], ...] = ()
    flags: tuple[DataFlag, ...] = ()
    faults: tuple[Fault, ...] = ()
    reason: str = ""
    derived: tuple[tuple[str, str], ...] = ()


def entry(value: float, std: float | None, unit: str) -> _Entry:
    """Return a parameter as the contract writes it."""
    return {"value": float(value), "std": None if std is None else float(std), "unit": unit}


def fault_over(
    name: str,
    parameters: Mapping[str, _Entry],
    times_s: FloatArray,
    nats: float,
    *,
    shape: Mapping[str, float] | None = None,
    masked: NDArray[np.bool_] | None = None,
    domain: str = "time",
) -> Fault:
    """Return a fault of the samples at some times.

    Evidence that is paid for is the log of a Bayes factor: chance reaches it with less than its
    inverse.
    """
    chance = float(np.exp(-max(nats, 0.0)))
    span = (len(times_s), float(times_s[0]), float(times_s[-1]))
    return Fault(name, parameters, *span, nats, chance, shape or {}, masked=masked, domain=domain)


def flag_samples(
    name: str, time_s: FloatArray, mask: NDArray[np.bool_], detail: str = ""
) -> tuple[DataFlag, ...]:
    """Return one flag from the first to the last marked sample; none where none is marked."""
    at = time_s[mask]
    return (DataFlag(name, float(at[0]), float(at[-1]), len(at), detail),) if len(at) else ()


def flag_runs(name: str, time_s: FloatArray, mask: NDArray[np.bool_]) -> tuple[DataFlag, ...]:
    """Return one flag for each run of marked samples, one over all where there are many."""
    runs = mask_runs(mask)
    if len(runs) > _MANY:
        return flag_samples(name, time_s, mask)
    return tuple(DataFlag(name, float(time_s[a]), float(time_s[b]), b - a + 1) for a, b in runs)
