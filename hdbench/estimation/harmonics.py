"""Harmonics of an angle: columns, amplitudes with uncertainty, and where their lines lie."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.estimation.regression import LinearFit
from hdbench.records.quantity import Quantity, coverage_factor
from hdbench.records.trace import FloatArray

# amplitude over its own standard deviation from which a peak counts as a line; its power is then
# 18 times the background: a chance of 1.5e-8 per frequency, 1e-3 in a record of 1e5 samples
_LINE_SIGMA = 6.0
# below this many cycles in the record a slow drift and a line cannot be told apart
_LOWEST_BIN = 8
# bins of the running median: far wider than a tapered line, narrow against the noise's colour
_MEDIAN_BINS = 201
# bins on either side of a peak that tell its own surroundings: outside the lobe of the window,
# inside a bump of coloured noise, which must not be taken for a line
_NEAR_BINS = range(3, 13)
_MAX_LINES = 24
_ROUNDS = 3


def background(power: FloatArray, bins: int = _MEDIAN_BINS) -> FloatArray:
    """Return the mean noise power around each bin, from medians that lines cannot move."""
    half = bins // 2
    edges = np.arange(0, len(power) + half, half)
    centres = []
    levels = []
    for low, high in zip(edges[:-1], np.minimum(edges[1:] + half, len(power)), strict=True):
        block = power[low:high]
        if len(block) < 8:
            continue
        centres.append(0.5 * (low + high - 1))
        # the median of an exponential distribution is ln 2 times its mean
        levels.append(float(np.median(block)) / np.log(2.0))
    return np.asarray(np.interp(np.arange(len(power)), centres, levels))


def _surroundings(power: FloatArray) -> FloatArray:
    """Return the mean noise power beside each bin, its own lobe left out."""
    padded = np.pad(power, _NEAR_BINS.stop, mode="reflect")
    index = np.arange(len(power)) + _NEAR_BINS.stop
    around = np.array([padded[index + sign * k] for k in _NEAR_BINS for sign in (-1, 1)])
    return np.asarray(np.median(around, axis=0) / np.log(2.0))


def line_frequencies(series: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Return the frequencies of sinusoids above six standard deviations.

    Notes
    -----
    Periodogram under a Hann window against a running median and against the median of ten bins
    on either side of the peak, whichever is higher; the place of a peak is refined from its two
    neighbours: for this window and amplitudes c-, c0, c+ at bins -1, 0, +1 the
    offset towards the larger neighbour is ``(2 r - 1) / (r + 1)``, r the ratio of it to c0.

    References
    ----------
    .. [1] D. C. Rife, G. A. Vincent, Bell Syst. Tech. J. 49 (1970) 197.
    """
    n = len(series)
    if n < 8 * _LOWEST_BIN:
        return np.zeros(0)
    amplitude = np.abs(np.fft.rfft(series * np.hanning(n) * valid))
    power = amplitude**2
    level = np.maximum(background(power), _surroundings(power))
    ratio = power / np.maximum(level, np.finfo(float).tiny)
    inner = np.arange(max(_LOWEST_BIN, 1), len(power) - 1)
    peak = (
        (ratio[inner] > _LINE_SIGMA**2 / 2.0)
        & (power[inner] >= power[inner - 1])
        & (power[inner] > power[inner + 1])
    )
    bins = inner[peak]
    bins = bins[np.argsort(ratio[bins])[::-1]][:_MAX_LINES]
    side = np.where(amplitude[bins + 1] > amplitude[bins - 1], 1, -1)
    r = amplitude[bins + side] / amplitude[bins]
    offset = np.clip(side * (2.0 * r - 1.0) / (r + 1.0), -0.5, 0.5)
    return np.asarray((bins + offset) / n)


def without_lines(series: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Return the series with its sinusoids above six standard deviations fitted and removed."""
    time = np.arange(len(series)) - 0.5 * len(series)
    clean = series
    for _ in range(_ROUNDS):
        found = line_frequencies(clean, valid)
        if not len(found):
            break
        angle = 2.0 * np.pi * np.multiply.outer(time, found)
        design = np.hstack([np.cos(angle), np.sin(angle)])[valid]
        # the normal equations are well conditioned: peaks are at least two bins apart
        normal = design.T @ design + 1e-9 * len(design) * np.eye(design.shape[1])
        part = np.zeros_like(series)
        part[valid] = design @ np.linalg.solve(normal, design.T @ clean[valid])
        clean = clean - part
    return clean


# turns of the output from which its orders 1 and 2 and an offset are told apart without loss
TURNS_FOR_ORDER_2 = 1.5

# amplitude over its uncertainty below which it is biased upwards by the noise: at 3 the Rice
# distribution's mean exceeds the true amplitude by 6 % and its shape is no longer normal
_RICE_SIGMA = 3.0


@dataclass(frozen=True, slots=True)
class Harmonic:
    """One component ``amplitude * cos(order * angle + phase)``."""

    # amplitude, unit of the response, at least 0
    amplitude: Quantity
    # phase, rad, in (-pi, pi]
    phase: Quantity
    # true where the amplitude is below three of its standard uncertainties: then it is biased
    # upwards (Rice distribution), and the phase is hardly known
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
    from scipy.special import stdtridf

    variance = math.fsum(std**2 for std, _ in parts)
    if not variance > 0.0:
        dofs = [dof for _, dof in parts if dof is not None]
        return 0.0, min(dofs) if dofs else None
    square = math.fsum((coverage_factor(dof) * std) ** 2 for std, dof in parts)
    factor = math.sqrt(square / variance)
    # the factor of a million dof: beyond it Student's t is the normal distribution
    if factor < coverage_factor(None) + 2.5e-6:
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
