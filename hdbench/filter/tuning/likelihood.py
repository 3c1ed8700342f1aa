"""Likelihood of the innovations with the measurement noise concentrated out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hdbench.filter.assemble import state_space
from hdbench.filter.channels import Channels
from hdbench.filter.kalman import new_state, run
from hdbench.filter.model import FilterModel

__all__ = ["Score", "score"]


@dataclass(frozen=True, slots=True)
class Score:
    """How well a model of measurement noise 1 foretells the traces.

    Parameters
    ----------
    samples : int
        Samples used.
    noise_nm2 : float
        The measurement noise that fits best, (N m)^2; every other noise scales with it.
    log_likelihood : float
        Gaussian log-likelihood at that noise, nats.
    """

    samples: int
    noise_nm2: float
    log_likelihood: float


def score(model: FilterModel, records: Sequence[Channels]) -> Score:
    r"""Score a model of measurement noise 1 on traces.

    Notes
    -----
    With innovations e and variances S of the relative model over n samples of all traces,
    :math:`\hat R = \sum e^2/S / n` and
    :math:`2 \ln L = -n (1 + \ln 2\pi + \ln \hat R) - \sum \ln S`.
    """
    space = state_space(model)
    samples, logs, squares = 0, 0.0, 0.0
    for record in records:
        found = run(
            space,
            new_state(space),
            record.time_s,
            record.velocity_rad_s,
            record.torque_nm,
            angle_rad=record.angle_rad,
        )
        samples += found.n_used
        logs += found.sum_log_variance
        squares += found.sum_normalised_squares
    noise = squares / samples if samples else math.nan
    if not 0.0 < noise < math.inf:
        return Score(samples, noise, -math.inf)
    value = -0.5 * (samples * (1.0 + math.log(2.0 * math.pi * noise)) + logs)
    return Score(samples, noise, value)
