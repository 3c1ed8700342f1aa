"""The smallest effect that this record would have shown."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import gammaincc

from hdbench.diagnosis.detect.looks import SHARES, Looks
from hdbench.diagnosis.detect.survey import Survey

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


def _lines(looks: Looks, survey: Survey, alpha: float) -> list[tuple[str, float]]:
    limits = []
    for scan, law in zip(survey.scans, survey.scan_laws, strict=True):
        result = looks.scans[scan.domain]
        finite = result.sigma[np.isfinite(result.sigma)]
        if len(finite):
            c = _threshold(law.probability, alpha * SHARES[scan.domain])
            size = float(np.median(finite)) * (float(np.sqrt(c)) + _POWER)
            limits.append((_SCAN_NAMES[scan.domain], size))
    for known in survey.known:
        scan = survey.scans[known.scan]
        sigma = looks.scans[scan.domain].sigma[known.inside]
        finite = sigma[np.isfinite(sigma)]
        if len(finite):
            c = _threshold(known.law.probability, alpha * SHARES["known"] / len(survey.known))
            size = float(np.median(finite)) * (float(np.sqrt(c)) + _POWER)
            limits.append((known.name.replace("known orders", "ripple-harmonic"), size))
    for cause, law in survey.steps:
        # a step in the middle of the record, whitened at 0 Hz
        gain = float(np.abs(looks.whitener.power_gain(np.zeros(1))[0]))
        sigma_nm = 2.0 / (gain * float(np.sqrt(looks.whitener.used.sum())))
        c = _threshold(law.probability, alpha * SHARES["families"] / (survey.law.together + 1.0))
        limits.append((cause.name, sigma_nm * (float(np.sqrt(c)) + _POWER)))
    for cause, law in survey.combs:
        scan = next(s for s in survey.scans if s.domain == "motor-order")
        sigma = looks.scans[scan.domain].sigma
        finite = sigma[np.isfinite(sigma)]
        if len(finite):
            c = _threshold(law.probability, alpha * SHARES["combs"] / len(survey.combs))
            size = float(np.median(finite)) * (float(np.sqrt(c)) + _POWER)
            limits.append((cause.name, size))
    return limits


def minimum_detectable(looks: Looks, survey: Survey, alpha: float) -> tuple[tuple[str, float], ...]:
    """Return the amplitude of each kind of effect that would have been found with 90 %.

    Parameters
    ----------
    looks : Looks
        Looks at the final residual.
    survey : Survey
        Plan of the looks.
    alpha : float
        False-alarm rate of the record.

    Returns
    -------
    tuple of (str, float)
        Name, once each, and amplitude, N m: the median over the axis for lines (the smaller one of
        any place and known places), the largest torque on this record for families.

    Notes
    -----
    An effect of d standard deviations gives a statistic whose root is near normal about d with
    unit variance; it passes the threshold c with 90 % from ``d = sqrt(c) + 1.28``.
    """
    limits = _lines(looks, survey, alpha)
    dof, members = looks.bank.dof(), survey.bank.members
    for name, index in survey.bank.families.items():
        whole = [k for k in index if members[k].whole]
        alive = [k for k in whole if dof[k] > 0 and np.isfinite(looks.bank.sigma_nm[k])]
        if not alive or name not in survey.law.families:
            continue
        half = 0.5 * int(dof[alive[0]])
        share = alpha * SHARES["families"] / survey.law.together

        def chance(c: float, half: float = half, name: str = name) -> float:
            p = np.array([float(gammaincc(half, 0.5 * c))])
            return float(survey.law.families[name].probability(p)[0])

        sigma = float(np.median(looks.bank.sigma_nm[alive]))
        limits.append((name, sigma * (float(np.sqrt(_threshold(chance, share))) + _POWER)))
    smallest: dict[str, float] = {}
    for name, size in limits:
        smallest[name] = min(size, smallest.get(name, np.inf))
    return tuple(smallest.items())
