"""The transfer function measured: sinusoids through the running filter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdbench.filter.assemble import state_space
from hdbench.filter.kalman import new_state, run
from hdbench.filter.model import FilterModel
from hdbench.filter.statespace import StateSpace
from hdbench.filter.steady import SteadyFilter, steady_filter

__all__ = ["Injection", "inject"]


@dataclass(frozen=True, slots=True)
class Injection:
    """A sinusoid sent through the running filter, beside the algebra.

    Parameters
    ----------
    frequency_hz : float
        Frequency, Hz.
    measured, algebra : float
        ``|H|`` by injection and by the steady gain.
    """

    frequency_hz: float
    measured: float
    algebra: float


def inject(
    model: FilterModel,
    velocity_rad_s: float,
    sample_period_s: float,
    frequency_hz: Sequence[float],
    *,
    samples: int = 60_000,
) -> tuple[Injection, ...]:
    """Send sinusoids through the running filter and measure what comes out.

    Notes
    -----
    The recursion starts at its steady variances, so that its gain is soon the steady one; what its
    states have not forgotten by the second half is left in the answer.
    """
    steady = steady_filter(model, velocity_rad_s, sample_period_s)
    space = _steady_start(model, steady)
    time = np.arange(samples) * sample_period_s
    velocity = np.full(samples, velocity_rad_s)
    found = []
    for hz in frequency_hz:
        angle = 2.0 * math.pi * hz * time
        block = run(space, new_state(space), time, velocity, np.cos(angle))
        late = slice(samples // 2, samples)
        basis = np.stack((np.cos(angle), np.sin(angle)), axis=1)[late, : 2 if hz > 0.0 else 1]
        fit = np.linalg.lstsq(basis, block.torque_filtered_nm[late], rcond=None)[0]
        algebra = float(abs(steady.transfer(np.array([hz]))[0]))
        found.append(Injection(hz, float(np.hypot.reduce(fit)), algebra))
    return tuple(found)


def _steady_start(model: FilterModel, steady: SteadyFilter) -> StateSpace:
    """Return the model with the steady variances as its prior, and no gate."""
    space = state_space(model)
    variances = np.diag(steady.covariance)
    blocks = list(space.blocks)
    for place, index in enumerate(space.kernel_order()):
        first, second = variances[2 * place : 2 * place + 2].tolist()
        blocks[index] = replace(
            blocks[index],
            prior_variance=max(first, 0.0),
            prior_variance_2=max(second, 0.0),
        )
    return replace(space, blocks=tuple(blocks), start="prior", gate_sigma=None)
