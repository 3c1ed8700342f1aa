"""Missing, clipped, spiky and coarse samples of a clean record as causes."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.acquisition.coarse import comb_matters, quantised
from hdbench.diagnosis.acquisition.codes import clipped_samples, find_comb
from hdbench.diagnosis.acquisition.collect import Cost, clipping, gaps, spiky
from hdbench.diagnosis.acquisition.measure import baseline_residual
from hdbench.diagnosis.acquisition.named import Acquired
from hdbench.diagnosis.acquisition.stamps import repeated_rows
from hdbench.diagnosis.acquisition.task import Clean, Task
from hdbench.diagnosis.measured.record import Record, torque_from_trace

__all__ = ["masked_causes"]


def masked_causes(task: Task, clean: Clean, rng: np.random.Generator) -> list[Acquired]:
    """Return missing, clipped, spiky and coarse samples as causes.

    Parameters
    ----------
    task : Task
        Task.
    clean : Clean
        Record without the masked samples and without spikes.
    rng : Generator
        For the bootstrap.

    Returns
    -------
    list of Acquired
    """
    profile, inspected = task.profile.data, clean.inspected
    trace, flags = inspected.trace, inspected.preflight.flags
    torque = torque_from_trace(trace, profile)
    clipped = clipped_samples(trace, profile, torque)
    held = repeated_rows(inspected.given)
    missing = any(flag.name == "missed-samples" for flag in flags)
    comb = find_comb(torque)
    scatter = _scatter(clean.record)
    coarse = comb is not None and comb_matters(comb, profile, scatter)
    if not (missing or clipped.any() or clean.spikes.any() or coarse):
        return []
    full = task.prepare(trace, np.zeros(len(torque), dtype=bool))
    residual = baseline_residual(full, ~clean.record.valid)
    cost = Cost(residual, clean.record.valid, trace.time_s, rng)
    found = [*gaps(flags, held, cost), *clipping(torque, clipped, cost)]
    found += spiky(clean.spikes, residual.left_nm, cost)
    if coarse and comb is not None:
        found.append(quantised(comb, full, profile, cost))
    return found


def _scatter(record: Record) -> float:
    """Return the robust scatter of the baseline's residual, N m."""
    left = baseline_residual(record)
    values = np.abs(left.left_nm[left.valid])
    return float(np.quantile(values, 0.6827)) if len(values) else 0.0
