"""What a calibration hands out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hdbench.calibration.acceptance import Acceptance
from hdbench.calibration.course import course_dict, sequence_deviations, shunt_dict
from hdbench.calibration.lines import ExperimentLine
from hdbench.calibration.metrology import Metrology
from hdbench.calibration.metrologydict import metrology_dict
from hdbench.calibration.montecarlo import MonteCarlo
from hdbench.calibration.readings import TakenReading
from hdbench.calibration.readingsout import reading_dict
from hdbench.profile.schema import ProfileData
from hdbench.records.loads import SequenceEntry
from hdbench.records.quantity import Quantity
from hdbench.results import DataFlag

__all__ = ["CalibrationResult"]


@dataclass(frozen=True, slots=True)
class CalibrationResult:
    """What a set of loading experiments says about the torque gain.

    Parameters
    ----------
    gain_nm_per_v : Quantity
        Plain mean of the experiments' gains, N m/V.
    gain_basis : str
        What its uncertainty rests on: ``positions``, ``positions-unbalanced``, ``repetitions`` or
        ``residual``.
    gain_basis_reason : str
        One line that says why.
    consistency : float or None
        Standard deviation (ddof 1) over mean of the gains; None for one experiment.
    consistency_interval : tuple of float or None
        95 % interval of it by chi-square, gains taken as independent.
    consistency_interval_positions : tuple of float or None
        The same with the effective dof of gains that share positions.
    consistency_interval_vangel : tuple of (float, float or None) or None
        Interval of a coefficient of variation; upper end None where unbounded.
    max_consistency : float
        Limit of acceptance.
    acceptance : Acceptance
        Every limit that was tested, and the decision.
    experiments : tuple of ExperimentLine
        One line each.
    flags : tuple of DataFlag
        What makes the data doubtful.
    notes : tuple of DataFlag
        What limits the evaluation of sound data, and readings that stand off their line.
    n_samples : int
        Readings used.
    metrology : Metrology
        Steps, positions, directions, budget.
    monte_carlo : MonteCarlo or None
        The gain by Monte Carlo, where it was asked for.
    readings : tuple of TakenReading
        All readings with the applied torque that was used, preloads among them.
    bench : ProfileData or None
        Arm, standards and identity.
    sequence : tuple of SequenceEntry
        Course of the calibration; empty where it is not told.
    """

    gain_nm_per_v: Quantity
    gain_basis: str
    gain_basis_reason: str
    consistency: float | None
    consistency_interval: tuple[float, float] | None
    consistency_interval_positions: tuple[float, float] | None
    consistency_interval_vangel: tuple[float, float | None] | None
    max_consistency: float
    acceptance: Acceptance
    experiments: tuple[ExperimentLine, ...]
    flags: tuple[DataFlag, ...]
    notes: tuple[DataFlag, ...]
    n_samples: int
    metrology: Metrology
    monte_carlo: MonteCarlo | None
    readings: tuple[TakenReading, ...]
    bench: ProfileData | None
    sequence: tuple[SequenceEntry, ...]

    @property
    def accepted(self) -> bool | None:
        """Whether every limit is held; None where one could not be tested and none is broken."""
        return self.acceptance.accepted

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
        gain = self.gain_nm_per_v.value
        arm = None if self.bench is None else self.bench.arm
        course = course_dict(self.readings, self.sequence)
        return {
            "schema": "hdbench/calibration/1",
            **header,
            "title": "Calibration record",
            "gain_nm_per_v": self.gain_nm_per_v.to_dict(),
            "gain_basis": self.gain_basis,
            "gain_basis_reason": self.gain_basis_reason,
            "consistency": self.consistency,
            "consistency_interval": _listed(self.consistency_interval),
            "consistency_interval_positions": _listed(self.consistency_interval_positions),
            "consistency_interval_vangel": _listed(self.consistency_interval_vangel),
            "max_consistency": self.max_consistency,
            "n_experiments": len(self.experiments),
            "accepted": self.accepted,
            "acceptance": self.acceptance.to_dict(),
            "experiments": [line.to_dict() for line in self.experiments],
            **metrology_dict(self.metrology, self.experiments, gain, arm),
            "experiment_steps": self._experiment_steps(),
            "monte_carlo": None if self.monte_carlo is None else self.monte_carlo.to_dict(),
            "course": course,
            "shunt": shunt_dict(self.readings, self.sequence, self._shunt(), gain),
            "deviations": sequence_deviations(self.metrology, course["n_preloads"]),
            **self._declared(),
            "sequence": [entry.to_dict() for entry in self.sequence],
            "readings": [reading_dict(taken) for taken in self.readings],
            "flags": [flag.to_json() for flag in self.flags],
            "notes": [note.to_json() for note in self.notes],
            "n_samples": self.n_samples,
        }

    def _experiment_steps(self) -> list[dict[str, Any]]:
        return [
            {"experiment": line.id, **step.to_dict()}
            for line in self.experiments
            for step in line.steps
        ]

    def _shunt(self) -> Any:
        return None if self.bench is None else self.bench.calibration.shunt

    def _declared(self) -> dict[str, Any]:
        """Return what the profile declares: standards, identity, arm, validity."""
        bench = self.bench
        if bench is None:
            return {"standards": None, "identity": None, "arm": None, "validity_days": None}
        return {
            "standards": bench.standards.model_dump(),
            "identity": {
                **bench.identity.model_dump(),
                "excitation_v": bench.sensor.excitation_v,
                "amplifier_gain": bench.sensor.amplifier_gain,
                "gauge_factor": bench.sensor.gauge_factor,
                "gear_ratio": bench.drive.gear_ratio,
                "rated_torque_nm": bench.drive.rated_torque_nm,
            },
            "arm": bench.arm.model_dump(),
            "validity_days": bench.calibration.validity_days,
            "average_s": bench.calibration.average_s,
        }


def _listed(interval: tuple[float, float | None] | None) -> list[float | None] | None:
    return None if interval is None else list(interval)
