"""Amplitude and phase of (cosine, sine) pairs, with uncertainties."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.model.definition import Cause
from hdbench.records.trace import FloatArray


@dataclass(frozen=True, slots=True)
class Quadratures:
    """Names of a (cosine, sine) pair of linear parameters and of what it is stated as."""

    cosine: str
    sine: str
    amplitude: str
    phase: str
    unit: str


def quadratures(cause: Cause) -> tuple[Quadratures, ...]:
    """Return the (cosine, sine) pairs among the linear parameters."""
    units = {parameter.name: parameter.unit for parameter in cause.linear}
    pairs = []
    for name, unit in units.items():
        rest = name.removeprefix("cosine")
        if rest == name or f"sine{rest}" not in units:
            continue
        phase = f"phase{rest.rpartition('_')[0]}_rad"
        pairs.append(Quadratures(name, f"sine{rest}", f"amplitude{rest}", phase, unit))
    return tuple(pairs)


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
    """Return the root of a variance."""
    return math.sqrt(variance) if 0.0 <= variance < math.inf else None
