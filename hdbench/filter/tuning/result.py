"""Result of a tuning: model, estimates, kinds of slow torque tried, checks."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hdbench.filter.model import FilterModel
from hdbench.filter.tuning.checks import Consistency
from hdbench.records import FloatArray


@dataclass(frozen=True, slots=True)
class Start:
    """Where one start of the search ended."""

    log_likelihood: float
    evaluations: int
    converged: bool
    slope_nats: float  # largest left where no bound holds, per standard error or factor e


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
            "starts": [
                {
                    "log_likelihood_nats": start.log_likelihood
                    if math.isfinite(start.log_likelihood)
                    else None,
                    "evaluations": start.evaluations,
                    "converged": start.converged,
                    "slope_nats": start.slope_nats if math.isfinite(start.slope_nats) else None,
                }
                for start in self.optimum.starts
            ],
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
            "consistency": self.consistency.to_dict(),
            "outliers": self.outliers,
            "notes": list(self.notes),
        }
