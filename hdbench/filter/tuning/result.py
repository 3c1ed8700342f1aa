"""Result of a tuning: estimates, candidates, and consistency of the innovations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hdbench.filter.kalman import GATED
from hdbench.filter.model import FilterModel
from hdbench.filter.online import Channels, run_channels
from hdbench.records import FloatArray
from hdbench.results import Part

_PARTS = 8
# start of each trace that is left out: there the prior speaks
_SETTLE_S = 1.0


class NormalisedSquares(Part):
    """Mean of the squared normalised innovations: 1 where variances are right."""

    value: float
    band: tuple[float, float]  # 95 % for white normal innovations, from chi-square
    parts: tuple[float, ...]  # over eight parts of the record, in time
    parts_band: tuple[float, float]


class Whiteness(Part):
    """Test of Ljung and Box, and how far the innovations are from white."""

    lags: int
    ljung_box: float
    p_value: float  # of a larger statistic for white innovations
    largest_autocorrelation: float  # in magnitude, among these lags


class Consistency(Part):
    """Innovations of a model on traces, held against what it claims of them."""

    samples: int
    gated: int
    nis: NormalisedSquares
    whiteness: Whiteness


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
        nis=NormalisedSquares(
            value=float(np.mean(squares)),
            band=nis_band(squares.size),
            parts=tuple(float(np.mean(squares[a:b])) for a, b in pairwise(edges.tolist())),
            parts_band=nis_band(squares.size // _PARTS),
        ),
        whiteness=Whiteness(
            lags=lags,
            ljung_box=statistic,
            p_value=p_value,
            largest_autocorrelation=float(correlation[np.argmax(np.abs(correlation))]),
        ),
    )


@dataclass(frozen=True, slots=True)
class Start:
    """Where one start of the search ended."""

    log_likelihood: float
    evaluations: int
    converged: bool
    slope_nats: float  # largest left where no bound holds, per standard error or factor e

    def to_dict(self) -> dict[str, object]:
        """Return the start as results store it."""
        reached, slope = self.log_likelihood, self.slope_nats
        return {
            "log_likelihood_nats": reached if math.isfinite(reached) else None,
            "evaluations": self.evaluations,
            "converged": self.converged,
            "slope_nats": slope if math.isfinite(slope) else None,
        }


@dataclass(frozen=True, slots=True)
class Optimum:
    """The best point over all starts."""

    logs: FloatArray
    log_likelihood: float
    starts: tuple[Start, ...]
    agreed: int  # starts that ended within 0.02 nats of the best


@dataclass(frozen=True, slots=True)
class Estimate:
    """One number of the model and how sharply the data fix it."""

    name: str
    unit: str
    value: float
    relative_std: float | None  # of its logarithm; None where the likelihood has no peak in it
    below: float | None = None  # without a peak: beyond it the likelihood falls by two nats
    above: float | None = None
    held: bool = False  # the least at which the block remembers no longer than the traces
    lowered: bool = False  # less than most likely, so that the block leaves the torque alone

    @property
    def determined(self) -> bool:
        """Whether the data fix the number within a factor of about 7 either way (two sigma)."""
        return self.relative_std is not None and self.relative_std < 1.0

    def to_dict(self) -> dict[str, object]:
        """Return the estimate as results store it."""
        std = None if self.relative_std is None else self.relative_std * self.value
        return {
            "name": self.name,
            "unit": self.unit,
            "estimate": {"value": self.value, "std": std, "dof": None},
            "log_std": self.relative_std,
            "determined": self.determined,
            "below": self.below,
            "above": self.above,
            "held_at_memory_of_traces": self.held,
            "lowered_to_leave_torque": self.lowered,
        }


@dataclass(frozen=True, slots=True)
class CandidateResult:
    """One kind of slow torque that was tried."""

    slow: str
    log_likelihood: float
    penalised: float  # less half a log n for each number varied: this is compared
    optimum: Optimum
    refused: str | None = None

    def to_dict(self) -> dict[str, object]:
        """Return the candidate as results store it."""
        return {
            "slow": self.slow,
            "log_likelihood_nats": self.log_likelihood,
            "penalised_nats": self.penalised,
            "refused": self.refused,
            "starts": [start.to_dict() for start in self.optimum.starts],
            "starts_agreed": self.optimum.agreed,
        }


@dataclass(frozen=True, slots=True)
class TuningResult:
    """A tuned model and what speaks for it.

    Parameters
    ----------
    model : FilterModel
        The tuned model.
    estimates : tuple of Estimate
        Its tuned numbers; the measurement noise first.
    candidates : tuple of CandidateResult
        Kinds of slow torque that were tried; the chosen one first.
    consistency : Consistency
        Innovations of the model on the traces it was tuned on.
    outliers : int
        Samples left out as outliers.
    notes : tuple of str
        What the data cannot determine, and what else a user should know.
    """

    model: FilterModel
    estimates: tuple[Estimate, ...]
    candidates: tuple[CandidateResult, ...]
    consistency: Consistency
    outliers: int
    notes: tuple[str, ...]

    @property
    def converged(self) -> bool:
        """Whether the best start of the chosen kind ended by itself."""
        starts = self.candidates[0].optimum.starts
        return max(starts, key=lambda start: start.log_likelihood).converged

    def to_dict(self) -> dict[str, object]:
        """Return everything but the model as its file and the command's result store it."""
        return {
            "method": "maximum likelihood of the innovations, measurement noise concentrated out",
            "converged": self.converged,
            "parameters": [estimate.to_dict() for estimate in self.estimates],
            "slow_candidates": [candidate.to_dict() for candidate in self.candidates],
            "consistency": self.consistency.to_json(),
            "outliers": self.outliers,
            "notes": list(self.notes),
        }
