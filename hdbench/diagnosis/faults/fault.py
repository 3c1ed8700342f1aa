"""Fault of the acquisition with its evidence, and what an inspection of the channels found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.faults.scatter import mask_runs
from hdbench.records.trace import FloatArray, Trace
from hdbench.results.diagnosis import ParameterValue, StretchFlag


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of the acquisition, by its name of the catalogue."""

    name: str
    parameters: dict[str, ParameterValue]
    samples: int  # that it touches
    from_s: float
    to_s: float
    evidence_nats: float  # gain of the log likelihood less its price
    false_alarm_probability: float
    shape: Mapping[str, float] = field(default_factory=dict)  # for the model file
    group: tuple[str, ...] = ()  # other names that these data cannot tell from it
    undone: Trace | None = None  # the trace with every fault taken out but this one
    masked: NDArray[np.bool_] | None = None  # samples that are left out for it
    domain: str = "time"  # axis on which it is plainest
    share: float | None = None  # of the noise's variance, where that is what it changes

    def flag(self) -> StretchFlag:
        """Return its samples as a flag."""
        return StretchFlag(self.name, self.from_s, self.to_s, self.samples)


@dataclass(frozen=True, slots=True)
class Inspected:
    """A trace whose channels were inspected, without the named faults of angle, tacho and clock."""

    trace: Trace
    masked: NDArray[np.bool_]  # samples that take no part
    left_out: tuple[tuple[str, int], ...] = ()  # why samples take no part, and how many
    flags: tuple[StretchFlag, ...] = ()  # doubtful samples, those of the faults among them
    faults: tuple[Fault, ...] = ()
    reason: str = ""  # why nothing can be said, with the margin
    derived: tuple[tuple[str, str], ...] = ()  # channels made of another one, and of which


def fault_over(
    name: str, parameters: dict[str, ParameterValue], times_s: FloatArray, nats: float, **more: Any
) -> Fault:
    """Return a fault of the samples at some times; its chance is that of its evidence by Bayes."""
    # evidence that is paid for is the log of a Bayes factor: chance reaches it no more often
    chance = float(np.exp(-max(nats, 0.0)))
    span = {"samples": len(times_s), "from_s": float(times_s[0]), "to_s": float(times_s[-1])}
    told = {**span, "evidence_nats": nats, "false_alarm_probability": chance, **more}
    return Fault(name, parameters, **told)


def flag_samples(
    name: str, time_s: FloatArray, mask: NDArray[np.bool_], detail: str = ""
) -> tuple[StretchFlag, ...]:
    """Return one flag from the first to the last marked sample; none where none is marked."""
    at = time_s[mask]
    return (StretchFlag(name, float(at[0]), float(at[-1]), len(at), detail),) if len(at) else ()


def flag_runs(name: str, time_s: FloatArray, mask: NDArray[np.bool_]) -> tuple[StretchFlag, ...]:
    """Return one flag for each run of marked samples, one over all where there are many."""
    runs = mask_runs(mask)
    # many stretches are told as one flag over all of them
    if len(runs) > 20:
        return flag_samples(name, time_s, mask)
    return tuple(StretchFlag(name, float(time_s[a]), float(time_s[b]), b - a + 1) for a, b in runs)
