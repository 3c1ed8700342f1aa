"""Consistency of innovations: whiteness, and their variance against that of the model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hdbench.filter.kalman import GATED
from hdbench.filter.model import FilterModel
from hdbench.filter.traces import Channels, run_channels
from hdbench.records import FloatArray

_PARTS = 8
# start of each trace that is left out: there the prior speaks
_SETTLE_S = 1.0


@dataclass(frozen=True, slots=True)
class Consistency:
    """Innovations of a model on traces, held against what it claims of them.

    Parameters
    ----------
    samples : int
        Innovations used.
    gated : int
        Samples that the gate refused.
    nis : float
        Mean of the squared normalised innovations; 1 where variances are right.
    nis_band : tuple of float
        95 % band of `nis` for white normal innovations, from chi-square.
    nis_parts : tuple of float
        The same mean over eight parts of the record, in time.
    parts_band : tuple of float
        95 % band of each of them.
    lags : int
        Lags of the whiteness test.
    ljung_box : float
        Statistic Q of Ljung and Box.
    p_value : float
        Probability of a larger Q for white innovations.
    largest_correlation : float
        The autocorrelation largest in magnitude among these lags: how far from white.
    """

    samples: int
    gated: int
    nis: float
    nis_band: tuple[float, float]
    nis_parts: tuple[float, ...]
    parts_band: tuple[float, float]
    lags: int
    ljung_box: float
    p_value: float
    largest_correlation: float

    def to_dict(self) -> dict[str, object]:
        """Return the checks as results store them."""
        return {
            "samples": self.samples,
            "gated": self.gated,
            "nis": {
                "value": self.nis,
                "band": list(self.nis_band),
                "parts": list(self.nis_parts),
                "parts_band": list(self.parts_band),
            },
            "whiteness": {
                "lags": self.lags,
                "ljung_box": self.ljung_box,
                "p_value": self.p_value,
                "largest_autocorrelation": self.largest_correlation,
            },
        }


def nis_band(samples: int) -> tuple[float, float]:
    """Return the 95 % band of the mean of `samples` squared standard normal variables."""
    from scipy.special import gammaincinv

    half = 0.5 * samples
    return (float(gammaincinv(half, 0.025)) / half, float(gammaincinv(half, 0.975)) / half)


def ljung_box(normalised: FloatArray, lags: int) -> tuple[float, float, FloatArray]:
    """Test normalised innovations for whiteness.

    References
    ----------
    .. [1] G. M. Ljung, G. E. P. Box, "On a measure of lack of fit in time series models",
       Biometrika 65 (1978) 297-303.
    """
    from scipy.special import gammaincc

    known = np.isfinite(normalised)
    n = int(np.count_nonzero(known))
    centred = np.where(known, normalised - np.mean(normalised[known]), 0.0)
    power = float(centred @ centred)
    correlation = np.array([float(centred[k:] @ centred[:-k]) / power for k in range(1, lags + 1)])
    weights = 1.0 / (n - np.arange(1, lags + 1))
    statistic = n * (n + 2.0) * float(np.square(correlation) @ weights)
    return statistic, float(gammaincc(0.5 * lags, 0.5 * statistic)), correlation


def check_innovations(model: FilterModel, records: Sequence[Channels]) -> Consistency:
    """Hold a model's innovations on traces against its claims.

    Parameters
    ----------
    model : FilterModel
        The model, with its gate.
    records : sequence of Channels
        The traces; the first second of each is left out: there the prior speaks.

    Returns
    -------
    Consistency
        Whiteness and variance of the innovations.
    """
    gated, parts = 0, []
    for record in records:
        found = run_channels(model, record)
        refused = (found.flags & GATED) != 0
        gated += int(np.count_nonzero(refused))
        normalised = found.innovation_nm / np.sqrt(found.innovation_variance_nm2)
        late = record.time_s >= record.time_s[0] + _SETTLE_S
        parts.append(np.where(refused, math.nan, normalised)[late])
    whole = np.concatenate(parts)
    squares = np.square(whole[np.isfinite(whole)])
    lags = 20
    if squares.size <= 10 * lags:
        raise ValueError(f"{squares.size} innovations after {_SETTLE_S} s; needed: {10 * lags}")
    statistic, p_value, correlation = ljung_box(whole, lags)
    edges = np.linspace(0, squares.size, _PARTS + 1).astype(int)
    return Consistency(
        samples=int(squares.size),
        gated=gated,
        nis=float(np.mean(squares)),
        nis_band=nis_band(squares.size),
        nis_parts=tuple(float(np.mean(squares[a:b])) for a, b in pairwise(edges.tolist())),
        parts_band=nis_band(squares.size // _PARTS),
        lags=lags,
        ljung_box=statistic,
        p_value=p_value,
        largest_correlation=float(correlation[np.argmax(np.abs(correlation))]),
    )
