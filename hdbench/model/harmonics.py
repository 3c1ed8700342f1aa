"""Amplitude and phase of (cosine, sine) pairs, with uncertainties."""

from __future__ import annotations

import math

import numpy as np

from hdbench.model.definition import Cause
from hdbench.records.trace import FloatArray

__all__ = ["amplitude_phase", "pair_tags", "standard_uncertainty"]


def pair_tags(cause: Cause) -> tuple[str, ...]:
    """Return the tags of the (cosine, sine) pairs among the linear parameters.

    Parameters
    ----------
    cause : Cause
        A cause.

    Returns
    -------
    tuple of str
        One tag per pair, in order: ``""`` for ``cosine_nm``, ``"_2"`` for ``cosine_2_nm``.
    """
    names = [parameter.name for parameter in cause.linear]
    return tuple(
        name.removeprefix("cosine").removesuffix("_nm")
        for name in names
        if name.startswith("cosine") and name.replace("cosine", "sine", 1) in names
    )


def amplitude_phase(
    cosine: float, sine: float, covariance: FloatArray | None = None
) -> tuple[float, float, float | None, float | None]:
    r"""Return amplitude and phase of ``cosine cos(x) + sine sin(x) = A cos(x + phase)``.

    Parameters
    ----------
    cosine, sine : float
        Coefficients, one unit.
    covariance : ndarray, shape (2, 2), or None
        Their covariance.

    Returns
    -------
    amplitude : float
        :math:`A = \sqrt{c^2 + s^2}`, at least 0.
    phase : float
        :math:`\mathrm{atan2}(-s, c)`, rad, in (-pi, pi]; 0 where the amplitude is 0.
    amplitude_std, phase_std : float or None
        Standard uncertainties by linear propagation; None without covariance or at amplitude 0.
    """
    amplitude = math.hypot(cosine, sine)
    phase = math.atan2(-sine, cosine) if amplitude > 0.0 else 0.0
    if covariance is None or amplitude == 0.0:
        return amplitude, phase, None, None
    along = np.array([cosine, sine]) / amplitude
    across = np.array([sine, -cosine]) / amplitude**2
    return (
        amplitude,
        phase,
        standard_uncertainty(float(along @ covariance @ along)),
        standard_uncertainty(float(across @ covariance @ across)),
    )


def standard_uncertainty(variance: float) -> float | None:
    """Return the root of a variance.

    Parameters
    ----------
    variance : float
        A variance, square of any unit.

    Returns
    -------
    float or None
        Standard uncertainty; None where `variance` is negative or not finite.
    """
    return math.sqrt(variance) if 0.0 <= variance < math.inf else None
