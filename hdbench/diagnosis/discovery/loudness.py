"""Loudness of the noise where an effect acts: what one spectrum for a whole record does not say."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.discovery.bands import Bands
from hdbench.diagnosis.discovery.fit import Beside, Fit, Products
from hdbench.records.trace import FloatArray

# stretches into which a record is cut: what is left may be loud in short ones or drift over long
_STRETCHES = (12, 48, 192)
# noise is at most so many times as loud: what is left beside a strong effect is no noise alone
_LOUDEST = 10.0


def loudness(bands: Bands, torque: FloatArray, left: FloatArray, power: FloatArray) -> float:
    """Return the variance of an amplitude over that in the noise's spectrum, at least 1.

    Parameters
    ----------
    bands : Bands
        Bands of the record.
    torque, left : ndarray, shape (size,)
        Transform of the effect, less what all else can say of it, and of what the fit leaves.
    power : ndarray, shape (n_bands,)
        Noise in each band, (N m)^2.

    Notes
    -----
    Of each stretch the product of effect and residual, both whitened, has the variance of its
    share of the information if the noise is as loud everywhere and forgets. The sum of their
    squares over the whole information says what it is (clustered sandwich estimate); what chance
    gives so few stretches is taken off.

    References
    ----------
    .. [1] K.-Y. Liang, S. L. Zeger, Biometrika 73 (1986) 13, doi:10.1093/biomet/73.1.13.
    """
    root = np.sqrt(bands.spread(1.0 / power))
    effect, rest = bands.waves(np.stack([torque * root, left * root]))
    total, found = float(effect @ effect), 1.0
    if not total > 0.0:
        # what all else says already acts nowhere
        return found
    share, score = np.square(effect) / total, effect * rest
    for count in _STRETCHES:
        edges = np.linspace(0, len(effect), count, endpoint=False).astype(int)
        part, sums = np.add.reduceat(share, edges), np.add.reduceat(score, edges)
        several = 1.0 / float(part @ part)
        chance = 1.0 + 2.0 * float(np.sqrt(2.0 / several))
        found = max(found, float(sums @ sums) / total / chance)
    return min(found, _LOUDEST)


def loudness_beside(
    beside: Beside, rows: FloatArray, products: Products, amount: FloatArray
) -> float:
    """Return the loudness where a candidate acts, fitted beside a fit."""
    power = beside.spectrum.power
    cross = beside.factor @ (amount @ np.tensordot(1.0 / power, products.cross, 1))
    taken, others = np.stack([cross, beside.free]) @ beside.factor @ beside.rows
    own = amount @ rows - taken
    return loudness(beside.bands, own, beside.residual - own - others, power)


def loudness_of(fit: Fit, parts: list[int]) -> float:
    """Return the loudness where parts of a fit act."""
    beside = fit.beside(*parts)
    own = np.isin(fit.owner, parts) & ~fit.form
    torque = fit.coefficients[own] @ fit.rows[own]
    cross = beside.factor @ (beside.rows @ (torque * beside.whitening))
    torque = torque - (beside.factor.T @ cross) @ beside.rows
    return loudness(fit.bands, torque, fit.residual, fit.spectrum.power)
