"""What a diagnosis says, as records and as the object that the contract describes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.answer.records import (
    DataFlag,
    Gain,
    LeftOut,
    LeftOutSamples,
    RecordPart,
    Testable,
    Voice,
)
from hdbench.model import BenchModel
from hdbench.records.trace import FloatArray

__all__ = [
    "Diagnosis",
    "NamedCause",
    "Pictures",
    "Rest",
    "Spectrum",
    "Unexplained",
    "verdict_of",
]


@dataclass(frozen=True, slots=True)
class NamedCause:
    """One named cause (contract section 5).

    Parameters
    ----------
    name : str
        Name of the catalogue.
    group : tuple of str
        Names whose effect spans the same space on this record, `name` first.
    rivals : tuple of str
        Other names within 3 nats.
    parameters : mapping
        Name to ``{"value", "std", "unit"}``.
    evidence_nats : float
        Log likelihood gained less half a log of the samples for each parameter.
    false_alarm_probability : float
        Probability of such a finding anywhere on this record without any effect.
    gain : Gain
        Held-out residual without and with the cause.
    separating_experiment : str or None
        What would tell the names of group and rivals apart; None where there is one name.
    share_of_variance : float
        Part of the baseline's residual variance that it explains.
    domain : str
        Domain in which it is plainest.
    left_out : tuple of LeftOut
        What it gains in speeds, directions and loads from which it was not fitted.
    probability : float or None
        Of `group` among all names, in (0, 1]; None where no others were held against it.
    voices : tuple of Voice
        What each of several records says of it; empty for one alone.
    apart_chance : float or None
        Probability that records which share it differ so far; None where they may differ.
    """

    name: str
    group: tuple[str, ...]
    rivals: tuple[str, ...]
    parameters: Mapping[str, Mapping[str, float | str | None]]
    evidence_nats: float
    false_alarm_probability: float
    gain: Gain
    separating_experiment: str | None
    share_of_variance: float
    domain: str
    left_out: tuple[LeftOut, ...] = ()
    probability: float | None = None
    voices: tuple[Voice, ...] = ()
    apart_chance: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the cause as the contract writes it."""
        together = {
            "records": [one.to_dict() for one in self.voices],
            "disagreement": {
                "records": [one.record for one in self.voices if one.disagrees],
                "false_alarm_probability": self.apart_chance,
            },
        }
        return {
            "name": self.name,
            "group": list(self.group),
            "rivals": list(self.rivals),
            "parameters": {name: dict(entry) for name, entry in self.parameters.items()},
            "evidence_nats": self.evidence_nats,
            "probability": self.probability,
            "false_alarm_probability": self.false_alarm_probability,
            "gain": self.gain.to_dict(),
            "separating_experiment": self.separating_experiment,
            "share_of_variance": self.share_of_variance,
            "domain": self.domain,
            "held_out_conditions": [one.to_dict() for one in self.left_out],
            **(together if self.voices else {}),
        }


@dataclass(frozen=True, slots=True)
class Unexplained:
    """A part of the residual with a place and no name (contract section 5).

    Parameters
    ----------
    domain : str
        Domain of the contract.
    location : float
        Centre.
    extent : tuple of float
        Ends; for a line its 95 % interval.
    unit : str
        Unit of the place.
    size_nm : float
        Size, N m.
    share_of_variance : float
        Part of the baseline's residual variance.
    false_alarm_probability : float
        As for a cause.
    second_domain : str or None
        The other axis where it depends on two.
    record : str
        Of several records the one that has it; empty for one alone, and for all.
    """

    domain: str
    location: float
    extent: tuple[float, float]
    unit: str
    size_nm: float
    share_of_variance: float
    false_alarm_probability: float
    second_domain: str | None = None
    record: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return it as the contract writes it."""
        return {
            "domain": self.domain,
            "second_domain": self.second_domain,
            "location": self.location,
            "extent": list(self.extent),
            "unit": self.unit,
            "size_nm": self.size_nm,
            "share_of_variance": self.share_of_variance,
            "false_alarm_probability": self.false_alarm_probability,
            **({"record": self.record} if self.record else {}),
        }


@dataclass(frozen=True, slots=True)
class Rest:
    """What the extended model leaves above the noise (contract section 5).

    Parameters
    ----------
    heldout_rms_nm : float
        What the extended model leaves on blocks it was not fitted to, N m.
    noise_rms_nm : float
        What the noise alone would leave, N m.
    told : tuple of Unexplained
        Entries of `unexplained` that account for the difference; empty where it is not located.
    """

    heldout_rms_nm: float
    noise_rms_nm: float
    told: tuple[Unexplained, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return it as the contract writes it."""
        return {
            "heldout_rms_nm": self.heldout_rms_nm,
            "noise_rms_nm": self.noise_rms_nm,
            "told": [place.to_dict() for place in self.told],
        }


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Amplitudes of lines along one axis, without and with the causes.

    Parameters
    ----------
    domain : str
        ``motor-order``, ``output-order`` or ``frequency``.
    unit : str
        Unit of the axis.
    axis : ndarray, shape (m,)
        Order or frequency.
    before_nm, after_nm : ndarray, shape (m,)
        Largest amplitude in the cell of each point, N m.
    """

    domain: str
    unit: str
    axis: FloatArray
    before_nm: FloatArray
    after_nm: FloatArray


@dataclass(frozen=True, slots=True)
class Pictures:
    """Everything that a picture of the diagnosis needs; arrays of shape (n_samples,).

    Parameters
    ----------
    time_s, velocity_rad_s : ndarray
        Time, s, and motor velocity, rad/s.
    measured_nm, simulated_nm, extended_nm : ndarray
        Measured torque, the model as it was handed in, and the extended model, N m; NaN where
        lost.
    residual_before_nm, residual_after_nm : ndarray
        Measured less fitted baseline, and less baseline and causes, N m; NaN where not used.
    masked : ndarray of bool
        Samples that no fit used.
    spectra : tuple of Spectrum
        Lines before and after.
    acceleration_rad_s2, motor_angle_rad, output_angle_rad, applied_nm : ndarray
        Motor acceleration, angles of wave generator and output, and the known torque through the
        flexspline, N m.
    """

    time_s: FloatArray
    velocity_rad_s: FloatArray
    measured_nm: FloatArray
    simulated_nm: FloatArray
    extended_nm: FloatArray
    residual_before_nm: FloatArray
    residual_after_nm: FloatArray
    masked: NDArray[np.bool_]
    spectra: tuple[Spectrum, ...]
    acceleration_rad_s2: FloatArray
    motor_angle_rad: FloatArray
    output_angle_rad: FloatArray
    applied_nm: FloatArray


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Result of a diagnosis.

    Parameters
    ----------
    verdict : str
        Verdict of the contract.
    causes, minor : tuple of NamedCause
        Significant causes above and below the materiality line.
    unexplained, minor_unexplained : tuple of Unexplained
        Places without a name, above and below that line.
    data_flags : tuple of DataFlag
        Faults of the acquisition.
    minimum_detectable : tuple of (str, float)
        Amplitude, N m, that would have been found with 90 %.
    simulated, extended : mapping
        ``terms`` and ``heldout_rms_nm`` of baseline and extended model.
    model : BenchModel
        The extended model.
    settings : mapping
        False-alarm rate, materiality, seed, noise model and what else the verdict depends on.
    reason : str
        One sentence for a verdict that is none; empty otherwise.
    pictures : Pictures or None
        Data for pictures of a dynamic run; None where no baseline could be fitted.
    load_pictures : mapping of str to ndarray, shape (n_readings,), or None
        Data for pictures of calibration loads, columns of ``residual.csv``; None for a dynamic run,
        and as above.
    left_out : tuple of LeftOutSamples
        Samples that took no part, by reason.
    rest : Rest or None
        What is left above the noise; None where no model could be fitted.
    testable : tuple of Testable
        For each name of the catalogue, whether this record can show it.
    records : tuple of RecordPart
        Each of several records; empty for one alone.
    """

    verdict: str
    causes: tuple[NamedCause, ...]
    minor: tuple[NamedCause, ...]
    unexplained: tuple[Unexplained, ...]
    minor_unexplained: tuple[Unexplained, ...]
    data_flags: tuple[DataFlag, ...]
    minimum_detectable: tuple[tuple[str, float], ...]
    simulated: Mapping[str, Any]
    extended: Mapping[str, Any]
    model: BenchModel
    settings: Mapping[str, Any] = field(default_factory=dict)
    reason: str = ""
    pictures: Pictures | None = None
    load_pictures: Mapping[str, FloatArray] | None = None
    left_out: tuple[LeftOutSamples, ...] = ()
    rest: Rest | None = None
    testable: tuple[Testable, ...] = ()
    records: tuple[RecordPart, ...] = ()

    def to_dict(self, header: Mapping[str, Any], model_file: str | None = None) -> dict[str, Any]:
        """Return the result object of the contract.

        Parameters
        ----------
        header : mapping
            As `hdbench.records` makes it for every result.
        model_file : str or None
            Name of the file that holds the extended model.

        Returns
        -------
        dict
            JSON-able, without NaN or infinities.
        """
        return {
            **header,
            "verdict": self.verdict,
            "reason": self.reason,
            "causes": [cause.to_dict() for cause in self.causes],
            "minor": [cause.to_dict() for cause in self.minor],
            "unexplained": [place.to_dict() for place in self.unexplained],
            "minor_unexplained": [place.to_dict() for place in self.minor_unexplained],
            "data_flags": [flag.to_dict() for flag in self.data_flags],
            "left_out": [one.to_dict() for one in self.left_out],
            "rest": None if self.rest is None else self.rest.to_dict(),
            "testable": [one.to_dict() for one in self.testable],
            "minimum_detectable": [
                {"name": name, "amplitude_nm": amplitude}
                for name, amplitude in self.minimum_detectable
            ],
            "simulated": dict(self.simulated),
            "extended": dict(self.extended),
            "model_file": model_file,
            "settings": dict(self.settings),
            "records": [one.to_dict() for one in self.records],
        }


def verdict_of(causes: Sequence[NamedCause], places: Sequence[Unexplained]) -> str:
    """Return the verdict of the contract on what was found."""
    if causes and places:
        return "named-and-unexplained"
    if causes:
        return "named"
    return "unexplained" if places else "nothing-found"
