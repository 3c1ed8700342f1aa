"""The smallest effect that this record would have shown."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import gammaincc

from hdbench.diagnosis.looks import Looks, line_p_value, look_shares

__all__ = ["minimum_detectable"]

# standard normal quantile of 90 %
_POWER = 1.2815515655446004
_SCAN_NAMES = {
    "motor-order": "ripple-harmonic",
    "output-order": "output-order line",
    "frequency": "structural-tone",
}
# statistics beyond this have no p-value above the smallest double
_LARGEST = 1400.0


def _threshold(p_value: Callable[[float], float], level: float) -> float:
    """Return the statistic at which a p-value falls to `level`."""
    from scipy.optimize import brentq

    return float(brentq(lambda c: np.log(max(p_value(c), 1e-300)) - np.log(level), 0.0, _LARGEST))


def minimum_detectable(looks: Looks, alpha: float) -> tuple[tuple[str, float], ...]:
    """Return the amplitude of each kind of effect that would have been found with 90 %.

    Parameters
    ----------
    looks : Looks
        Looks at the final residual.
    alpha : float
        False-alarm rate of the record.

    Returns
    -------
    tuple of (str, float)
        Name and amplitude, N m: the median over the axis for lines, the largest torque on this
        record for families.

    Notes
    -----
    An effect of d standard deviations gives a statistic whose root is near normal about d with
    unit variance; it passes the threshold c with 90 % from ``d = sqrt(c) + 1.28``.
    """
    shares = look_shares(len(looks.families))
    limits = []
    for domain, result in looks.scans.items():
        finite = result.sigma[np.isfinite(result.sigma)]
        if not len(finite):
            continue
        rate = looks.scans[domain].rate
        level = alpha * shares[domain]
        c = _threshold(lambda c, rate=rate: line_p_value(c, rate), level)  # type: ignore[misc]
        limits.append(
            (_SCAN_NAMES[domain], float(np.median(finite)) * (float(np.sqrt(c)) + _POWER))
        )
    for hit in looks.families:
        level = alpha * shares["family"] / hit.trials
        half = hit.dof / 2.0
        c = _threshold(lambda c, half=half: float(gammaincc(half, c / 2.0)), level)  # type: ignore[misc]
        if np.isfinite(hit.sigma_nm):
            limits.append((hit.term.cause.name, hit.sigma_nm * (float(np.sqrt(c)) + _POWER)))
    return tuple(limits)
