"""Harmonic columns, and amplitude and phase of a fitted component."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.estimation.regression import LinearFit
from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray

__all__ = ["TURNS_FOR_ORDER_2", "Harmonic", "combine", "harmonic_at", "harmonic_columns", "scaled"]

# turns of the output from which its orders 1 and 2 and an offset are told apart without loss
TURNS_FOR_ORDER_2 = 1.5

# amplitude over its uncertainty below which it is biased upwards by the noise: at 3 the Rice
# distribution's mean exceeds the true amplitude by 6 % and its shape is no longer normal
_RICE_SIGMA = 3.0
# 0.975 quantile of the normal distribution
_NORMAL_95 = 1.959963984540054


@dataclass(frozen=True, slots=True)
class Harmonic:
    """One component ``amplitude * cos(order * angle + phase)``.

    Parameters
    ----------
    amplitude : Quantity
        Amplitude, unit of the response, at least 0.
    phase : Quantity
        Phase, rad, in (-pi, pi].
    small : bool
        True where the amplitude is below three of its standard uncertainties: then it is biased
        upwards (Rice distribution), and the phase is hardly known.
    """

    amplitude: Quantity
    phase: Quantity
    small: bool


def harmonic_columns(angle_rad: FloatArray, orders: Sequence[float]) -> FloatArray:
    """Return ``cos(order * angle)`` and ``sin(order * angle)`` for each order.

    Parameters
    ----------
    angle_rad : ndarray, shape (n,)
        Angle, rad.
    orders : sequence of float, length m
        Cycles per turn of that angle.

    Returns
    -------
    ndarray, shape (n, 2 m)
        Columns 2 i and 2 i + 1 are cosine and sine of order i.
    """
    columns = np.empty((len(angle_rad), 2 * len(orders)))
    for i, order in enumerate(orders):
        columns[:, 2 * i] = np.cos(order * angle_rad)
        columns[:, 2 * i + 1] = np.sin(order * angle_rad)
    return columns


def harmonic_at(fit: LinearFit, index: int) -> Harmonic:
    """Return amplitude and phase from the cosine and sine coefficients at `index`.

    Parameters
    ----------
    fit : LinearFit
        A fit whose columns `index` and `index + 1` are cosine and sine.
    index : int
        Column of the cosine.

    Returns
    -------
    Harmonic

    Notes
    -----
    With coefficients a, b: ``amplitude = hypot(a, b)``, ``phase = atan2(-b, a)``; covariance to
    first order through ``(a, b) / amplitude`` and ``(b, -a) / amplitude^2``. Where the amplitude
    is below three standard uncertainties, its std is the root mean variance of a and b, and that
    of the phase at most ``pi / sqrt(3)``, which is a phase known to nothing.

    References
    ----------
    .. [1] S. O. Rice, Bell Syst. Tech. J. 24 (1945) 46.
    """
    a, b = (float(c) for c in fit.coefficients[index : index + 2])
    cov = fit.covariance[index : index + 2, index : index + 2]
    amplitude = math.hypot(a, b)
    mean_std = math.sqrt(0.5 * float(np.trace(cov)))
    small = not amplitude > _RICE_SIGMA * mean_std
    unknown = math.pi / math.sqrt(3.0)
    if small:
        std = mean_std
        phase_std = min(unknown, mean_std / amplitude) if amplitude > 0.0 else unknown
    else:
        along = np.array([a, b]) / amplitude
        across = np.array([b, -a]) / amplitude**2
        std = math.sqrt(float(along @ cov @ along))
        phase_std = math.sqrt(float(across @ cov @ across))
    return Harmonic(
        Quantity(amplitude, std, fit.dof),
        Quantity(math.atan2(-b, a), phase_std, fit.dof),
        small,
    )


def combine(*parts: tuple[float, float | None]) -> tuple[float, float | None]:
    """Combine independent standard uncertainties with their degrees of freedom.

    Parameters
    ----------
    *parts : tuple of (float, float or None)
        Standard uncertainty, at least 0, and its dof; None where it is taken as known.

    Returns
    -------
    tuple of (float, float or None)
        Combined standard uncertainty and effective dof; None where nothing limits it.

    Notes
    -----
    ``u^2 = sum u_i^2``; the dof are those for which the 95 % interval is the root sum of squares
    of the parts' 95 % intervals: ``t(dof) u = sqrt(sum (t(dof_i) u_i)^2)``. The
    Welch-Satterthwaite formula, ``dof = u^4 / sum(u_i^4 / dof_i)``, gives intervals that are too
    short where a part with few dof meets a known one: with 3 dof beside a known part of a third
    of its size they cover 93.6 % instead of 95 %; those returned here cover 95.7 %, and between
    95 and 97 % at any ratio.

    References
    ----------
    .. [1] JCGM 100:2008, annex G.4, for the formula not used.
    """
    from scipy.special import stdtridf, stdtrit

    variance = math.fsum(std**2 for std, _ in parts)
    if not variance > 0.0:
        dofs = [dof for _, dof in parts if dof is not None]
        return 0.0, min(dofs) if dofs else None
    factors = [_NORMAL_95 if dof is None else float(stdtrit(dof, 0.975)) for _, dof in parts]
    square = math.fsum((k * std) ** 2 for k, (std, _) in zip(factors, parts, strict=True))
    factor = math.sqrt(square / variance)
    # the factor of a million dof: beyond it Student's t is the normal distribution
    if factor < _NORMAL_95 + 2.5e-6:
        return math.sqrt(variance), None
    return math.sqrt(variance), float(stdtridf(0.975, factor))


def scaled(quantity: Quantity, relative_std: float, dof: float | None) -> Quantity:
    """Add the relative uncertainty of a scale to a quantity that was measured with it.

    Parameters
    ----------
    quantity : Quantity
        Value and uncertainty without that of the scale.
    relative_std : float
        Standard uncertainty of the scale over the scale, at least 0.
    dof : float or None
        Degrees of freedom of `relative_std`.

    Returns
    -------
    Quantity
        Same value, combined uncertainty and dof, see `combine`.
    """
    std, combined = combine((quantity.std, quantity.dof), (abs(quantity.value) * relative_std, dof))
    return Quantity(quantity.value, std, combined)
