"""What a calibration hands out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hdbench.calibration.lines import ExperimentLine
from hdbench.estimation.channel import DataFlag
from hdbench.records.quantity import Quantity

__all__ = ["CalibrationResult"]


@dataclass(frozen=True, slots=True)
class CalibrationResult:
    """What a set of loading experiments says about the torque gain.

    Parameters
    ----------
    gain_nm_per_v : Quantity
        Plain mean of the experiments' gains, N m/V.
    gain_basis : str
        What its uncertainty rests on: ``positions``, ``positions-unbalanced`` or ``residual``.
    gain_basis_reason : str
        One line that says why.
    consistency : float or None
        Standard deviation (ddof 1) over mean of the gains; None for one experiment.
    consistency_interval : tuple of (float, float or None) or None
        95 % interval of it, gains taken as independent; upper end None where unbounded.
    consistency_interval_positions : tuple of (float, float or None) or None
        The same with the effective dof of gains that share positions.
    max_consistency : float
        Limit of acceptance.
    accepted : bool or None
        Whether the consistency is within the limit; None for one experiment.
    experiments : tuple of ExperimentLine
        One line each.
    flags : tuple of DataFlag
        What makes the data doubtful.
    notes : tuple of DataFlag
        What limits the evaluation of sound data, and readings that stand off their line.
    n_samples : int
        Readings used.
    """

    gain_nm_per_v: Quantity
    gain_basis: str
    gain_basis_reason: str
    consistency: float | None
    consistency_interval: tuple[float, float | None] | None
    consistency_interval_positions: tuple[float, float | None] | None
    max_consistency: float
    accepted: bool | None
    experiments: tuple[ExperimentLine, ...]
    flags: tuple[DataFlag, ...]
    notes: tuple[DataFlag, ...]
    n_samples: int

    def to_dict(self, header: Mapping[str, Any]) -> dict[str, Any]:
        """Return the result as it is stored.

        Parameters
        ----------
        header : mapping
            ``hdbench_version``, ``profile`` and what else the caller knows of the run.

        Returns
        -------
        dict
            The keys of the contract's section 5 and those of `CalibrationResult`.
        """
        steps = [
            {"experiment": line.id, **step.to_dict()}
            for line in self.experiments
            for step in line.steps
        ]
        return {
            "schema": "hdbench/calibration/1",
            **header,
            "gain_nm_per_v": self.gain_nm_per_v.to_dict(),
            "gain_basis": self.gain_basis,
            "gain_basis_reason": self.gain_basis_reason,
            "consistency": self.consistency,
            "consistency_interval": _listed(self.consistency_interval),
            "consistency_interval_positions": _listed(self.consistency_interval_positions),
            "max_consistency": self.max_consistency,
            "n_experiments": len(self.experiments),
            "accepted": self.accepted,
            "experiments": [line.to_dict() for line in self.experiments],
            "steps": steps,
            "class": None,
            "class_reason": "no metrological evaluation was made of these readings",
            "flags": [flag.to_dict() for flag in self.flags],
            "notes": [note.to_dict() for note in self.notes],
            "n_samples": self.n_samples,
        }


def _listed(interval: tuple[float, float | None] | None) -> list[float | None] | None:
    return None if interval is None else list(interval)
