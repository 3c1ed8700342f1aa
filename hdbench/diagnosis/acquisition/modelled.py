"""Faults of angle, tacho and clock as causes, each with the gain of taking it out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdbench.diagnosis.acquisition.faults import Fault, restored
from hdbench.diagnosis.acquisition.flags import DataFlag
from hdbench.diagnosis.acquisition.measure import Residual, baseline_residual, gain_of, share_of
from hdbench.diagnosis.acquisition.named import Acquired, acquired_cause
from hdbench.diagnosis.measured.record import Record
from hdbench.model import CauseTerm
from hdbench.records.trace import FloatArray, Trace

__all__ = ["faults_as_causes"]

_TELL_JUMPS = "a run with a tone of known frequency on the torque channel, or a return to a mark"
# faults that are named one by one at most; further ones are taken out alone
_MOST = 8


def faults_as_causes(
    trace: Trace,
    faults: list[Fault],
    record_of: Callable[[Trace], Record],
    rng: np.random.Generator,
) -> list[Acquired]:
    """Return faults of angle, tacho and clock as causes, each with the gain of taking it out.

    Parameters
    ----------
    trace : Trace
        Channels as they came.
    faults : list of Fault
        All of them.
    record_of : callable
        Gives the record of a trace.
    rng : Generator
        For the bootstrap.

    Returns
    -------
    list of Acquired
        The eight of the largest evidence, in order of time; each is measured with all others
        taken out.
    """
    if not faults:
        return []
    after = baseline_residual(record_of(restored(trace, faults)))
    first = sorted(range(len(faults)), key=lambda k: -faults[k].tail.nats)[:_MOST]
    found = []
    for k in sorted(first):
        fault = faults[k]
        others = [f for j, f in enumerate(faults) if j != k]
        before = baseline_residual(record_of(restored(trace, others)))
        both = before.valid & after.valid
        pair = Residual(before.left_nm, both), Residual(after.left_nm, both)
        cause = acquired_cause(
            fault.name,
            fault.parameters,
            fault.tail,
            (gain_of(*pair, rng), share_of(*pair)),
            domain="motor-order" if fault.name == "tacho-ripple" else "time",
            group=fault.group,
            experiment=_TELL_JUMPS,
        )
        found.append(Acquired(cause, (fault_flag(fault, trace.time_s),), fault_term(fault)))
    return found


def fault_flag(fault: Fault, time_s: FloatArray) -> DataFlag:
    """Return the flag of a fault.

    Parameters
    ----------
    fault : Fault
        Fault.
    time_s : ndarray, shape (n,)
        Time, s.

    Returns
    -------
    DataFlag
    """
    first, last = fault.span
    count = last - first + 1
    if fault.name == "missed-samples":
        count = int(float(fault.parameters["samples"]["value"] or 0.0))
    return DataFlag(fault.name, float(time_s[first]), float(time_s[last]), count)


def fault_term(fault: Fault) -> CauseTerm:
    """Return the term of the extended model.

    Parameters
    ----------
    fault : Fault
        Fault.

    Returns
    -------
    CauseTerm
    """
    return CauseTerm(fault.name, fault.shape, ())
