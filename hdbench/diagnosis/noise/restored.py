"""Noise models of residuals out of which slow columns were taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdbench.estimation import NoiseModel
from hdbench.records.trace import FloatArray

__all__ = ["restored"]

# the power at 0 Hz that is given back depends on the model that it makes
_ROUNDS = 3


def restored(model: NoiseModel, share: float) -> NoiseModel:
    """Return the model of a noise before slow columns were taken out of it.

    Parameters
    ----------
    model : NoiseModel
        Model of what was left.
    share : float
        Columns that were taken out per sample.

    Returns
    -------
    NoiseModel
        Of the same order.

    Notes
    -----
    k orthonormal columns that change slowly take ``k S(0) / n`` from every autocovariance at short
    lags, S(0) the noise's power at 0 Hz per sample: a pole at 0.9 is read as 0.886 where 50 columns
    were taken out of 8000 samples. It is given back, and the equations of Yule and Walker are
    solved again by Levinson's recursion.
    """
    covariance = _covariance(model)
    found = model
    for _ in range(_ROUNDS):
        power = (found.innovation_std / (1.0 - float(np.sum(found.coefficients)))) ** 2
        found = _levinson(covariance + share * power, model)
    return found


def _covariance(model: NoiseModel) -> FloatArray:
    """Return the autocovariances at lags 0 ... p that the predictors stand for."""
    covariance = np.zeros(model.order + 1)
    covariance[0] = model.stds[0] ** 2
    for lag in range(1, model.order + 1):
        shorter, last = model.predictors[lag - 1], model.predictors[lag][-1]
        earlier = covariance[lag - 1 : 0 : -1]
        covariance[lag] = float(shorter @ earlier) + last * model.stds[lag - 1] ** 2
    return covariance


def _levinson(covariance: FloatArray, model: NoiseModel) -> NoiseModel:
    """Return the autoregression of given autocovariances."""
    predictors: list[FloatArray] = [np.zeros(0)]
    powers = [float(covariance[0])]
    for lag in range(1, len(covariance)):
        last = predictors[-1]
        rest = covariance[lag] - float(last @ covariance[lag - 1 : 0 : -1])
        reflection = rest / powers[-1]
        predictors.append(np.concatenate([last - reflection * last[::-1], [reflection]]))
        powers.append(powers[-1] * (1.0 - reflection**2))
    return replace(model, predictors=tuple(predictors), stds=np.sqrt(np.array(powers)))
