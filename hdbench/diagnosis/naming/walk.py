"""A random walk of the zero as a named cause."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.answer.result import NamedCause
from hdbench.diagnosis.confirm.gain import Gain
from hdbench.diagnosis.search import Found
from hdbench.diagnosis.state import Walk
from hdbench.model import catalogue

__all__ = ["WALK", "walk_cause", "walk_shape"]

WALK = "zero-random-walk"


def walk_shape(found: Found) -> dict[str, float]:
    """Return the intensity of the random walk of a search's noise.

    Parameters
    ----------
    found : Found
        Result of the search.

    Returns
    -------
    dict of str to float
        ``intensity_nm_per_sqrt_s``: step of the zero in one second, N m per root of a second.

    Notes
    -----
    ``power / k^2`` at k half cycles in the span T, in units of the noise at 0 Hz, against the
    density ``s^2 / (2 pi f)^2`` of a walk, f = k / (2 T).
    """
    slow, noise = found.noise.slow, found.noise.model
    power = 0.0 if slow is None else slow.power
    span = float(np.ptp(found.record.motion.time_s))
    gain = float(np.abs(np.sum(found.noise.ar_kernel)))
    density = noise.innovation_std**2 * found.record.period_s * power / gain**2
    return {"intensity_nm_per_sqrt_s": float(np.sqrt(density) * np.pi / span)}


def walk_cause(found: Found, walk: Walk, variance: float, gain: Gain) -> NamedCause:
    """Return a random walk of the zero as a named cause.

    Parameters
    ----------
    found : Found
        Result of the search.
    walk : Walk
        What was accepted.
    variance : float
        Residual variance of the baseline, (N m)^2.
    gain : Gain
        Of what lies between blocks over the blocks themselves.

    Returns
    -------
    NamedCause
    """
    ((name, value),) = walk_shape(found).items()
    cause = catalogue()[WALK]
    span = float(np.ptp(found.record.motion.time_s))
    # mean square of a random walk about its mean
    share = min(1.0, value**2 * span / 6.0 / variance)
    return NamedCause(
        WALK,
        (WALK,),
        walk.rivals,
        {name: {"value": value, "std": None, "unit": cause.shape[0].unit}},
        walk.noise.gain_nats,
        walk.false_alarm,
        gain,
        cause.experiment if walk.rivals else None,
        share,
        "time",
    )
