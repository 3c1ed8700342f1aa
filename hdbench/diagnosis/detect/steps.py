"""Steps of the zero at any sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdbench.diagnosis.detect.exact import MIN_SHARE, exact_statistic
from hdbench.diagnosis.fit.terms import Term, term_columns
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.noise.whitened import Space
from hdbench.model import shape_bounds
from hdbench.records.trace import FloatArray

__all__ = ["at_best_step", "step_statistics"]

# places of a step that are tried exactly
_STEP_TRIALS = 6


def step_statistics(space: Space, pulls: FloatArray) -> FloatArray:
    """Return the statistic of a step of the zero at every sample.

    Parameters
    ----------
    space : Space
        Whitened residual.
    pulls : ndarray, shape (n, k)
        `Space.pull`, or draws of it.

    Returns
    -------
    ndarray, shape (n, k)
        chi^2 with one degree of freedom.

    Notes
    -----
    Sums from each sample to the end give all numerators at once; the whitened step's size is that
    of the kernel's sums, as if no sample were masked.
    """
    whitener = space.whitener
    count = len(space.pull)
    numerator = np.cumsum(pulls[::-1], axis=0)[::-1]
    sums = np.cumsum(whitener.kernel)
    rise = np.concatenate([sums, np.full(max(0, count - len(sums)), sums[-1])])[:count]
    size = np.cumsum(rise**2)[::-1] / whitener.std**2
    left = size
    for column in space.pull_basis.T:
        explained = np.cumsum(column[::-1])[::-1]
        left = left - explained * explained
    usable = (left > MIN_SHARE * size) & space.whitener.valid
    weight = np.where(usable, 1.0 / np.maximum(left, 1e-300), 0.0)
    return np.asarray(numerator**2 * weight[:, None])


def at_best_step(space: Space, record: Record, term: Term) -> Term:
    """Return a step in time moved to the sample where it fits best.

    A shape that jumps has no slope to follow: the best few of all samples are tried exactly, and
    the place it came from.

    Parameters
    ----------
    space : Space
        Whitened residual without the term.
    record : Record
        Record.
    term : Term
        Term with a ``step_time_s``.

    Returns
    -------
    Term
    """
    statistic = step_statistics(space, space.pull[:, None])[:, 0]
    tops = np.argsort(-statistic, kind="stable")[:_STEP_TRIALS]
    bounds = shape_bounds(term.cause, record.motion)["step_time_s"]
    times = [float(record.motion.time_s[at]) for at in tops]
    tried = [term] + [
        replace(term, shape={**term.shape, "step_time_s": time})
        for time in times
        if any(low <= time <= high for low, high in bounds)
    ]
    values = [exact_statistic(space, term_columns(t, record))[0] for t in tried]
    return tried[int(np.argmax(values))]
