"""Result of a diagnosis: its records, and the object that the contract describes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hdbench.model import BenchModel
from hdbench.records.trace import FloatArray

Parameters = Mapping[str, Mapping[str, float | str | None]]
"""Name to ``{"value", "std", "unit"}``."""


def as_json(value: Any) -> Any:
    """Return a record as JSON holds it, its fields in their order."""
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if is_dataclass(value):
        return {one.name: as_json(getattr(value, one.name)) for one in fields(value)}
    if isinstance(value, Mapping):
        return {key: as_json(one) for key, one in value.items()}
    return [as_json(one) for one in value] if isinstance(value, list | tuple) else value


@dataclass(frozen=True, slots=True)
class Gain:
    """Held-out residual without and with a cause."""

    heldout_rms_before_nm: float
    heldout_rms_after_nm: float
    explained_fraction: float  # one less the ratio of the mean squares
    interval: tuple[float, float]  # 95 % interval of it by a paired block bootstrap


@dataclass(frozen=True, slots=True)
class Voice:
    """What one of several records says of a cause."""

    record: str
    evidence_nats: float  # by how much its likelihood falls without the cause
    gain: Gain
    parameters: Mapping[str, Mapping[str, Any]]  # as this record alone has them; may be empty
    disagrees: bool  # whether they are not those of the other records


@dataclass(frozen=True, slots=True)
class RecordPart:
    """The part of one record in a diagnosis of several; sizes are None where it took no part."""

    record: str
    left_out: str  # why it took no part; empty where it did
    samples: int  # that were used
    rate_hz: float
    simulated_rms_nm: float | None = None  # held-out residual with its baseline alone
    extended_rms_nm: float | None = None  # and with all causes
    noise_rms_nm: float | None = None
    disagrees: tuple[str, ...] = ()  # causes about which it says something else than the others
    settings: Mapping[str, Any] = field(default_factory=dict)  # as of a diagnosis of it alone

    def to_dict(self) -> dict[str, object]:
        """Return it as a JSON object."""
        return {
            "record": self.record,
            "left_out": self.left_out or None,
            "samples": self.samples,
            "rate_hz": self.rate_hz,
            "simulated": {"heldout_rms_nm": self.simulated_rms_nm},
            "extended": {"heldout_rms_nm": self.extended_rms_nm},
            "noise_rms_nm": self.noise_rms_nm,
            "disagrees": list(self.disagrees),
            "settings": dict(self.settings),
        }


@dataclass(frozen=True, slots=True)
class DataFlag:
    """A stretch of doubtful samples."""

    name: str
    from_s: float
    to_s: float
    samples: int
    detail: str = ""  # one sentence for a person, with numbers and units
    record: str = ""  # of several records the one that has them

    def to_dict(self) -> dict[str, object]:
        """Return the flag as the contract writes it: without empty words."""
        told = {one.name: getattr(self, one.name) for one in fields(self)}
        return {key: value for key, value in told.items() if value != ""}


@dataclass(frozen=True, slots=True)
class LeftOutSamples:
    """Samples that took no part in a diagnosis, for one reason."""

    reason: str
    samples: int
    share: float  # of all samples of the record


@dataclass(frozen=True, slots=True)
class Testable:
    """Whether a record can show one cause of the catalogue, and why not, or what of it not."""

    name: str
    testable: bool
    because: str = ""


@dataclass(frozen=True, slots=True)
class NamedCause:
    """One named cause (contract section 5)."""

    name: str
    group: tuple[str, ...]  # names whose effect spans the same space on this record, `name` first
    rivals: tuple[str, ...]  # other names within 3 nats
    parameters: Parameters
    evidence_nats: float
    false_alarm_probability: float  # of such a finding anywhere on a record without an effect
    gain: Gain
    separating_experiment: str | None  # None where there is one name
    share_of_variance: float  # part of the baseline's residual variance that it explains
    domain: str  # where it is plainest
    probability: float | None = None  # of `group` among all names; None without others
    voices: tuple[Voice, ...] = ()  # of several records
    apart_chance: float | None = None  # that records which share it differ so far

    def to_dict(self) -> dict[str, Any]:
        """Return the cause as the contract writes it."""
        together = {
            "records": as_json(self.voices),
            "disagreement": {
                "records": [one.record for one in self.voices if one.disagrees],
                "false_alarm_probability": self.apart_chance,
            },
        }
        return {
            "name": self.name,
            "group": list(self.group),
            "rivals": list(self.rivals),
            "parameters": as_json(self.parameters),
            "evidence_nats": self.evidence_nats,
            "probability": self.probability,
            "false_alarm_probability": self.false_alarm_probability,
            "gain": as_json(self.gain),
            "separating_experiment": self.separating_experiment,
            "share_of_variance": self.share_of_variance,
            "domain": self.domain,
            "held_out_conditions": [],
            **(together if self.voices else {}),
        }


@dataclass(frozen=True, slots=True)
class Unexplained:
    """A part of the residual with a place and no name (contract section 5)."""

    domain: str
    location: float
    extent: tuple[float, float]  # for a line its 95 % interval
    unit: str  # of the place
    size_nm: float
    share_of_variance: float
    false_alarm_probability: float
    second_domain: str | None = None  # the other axis where it depends on two
    record: str = ""  # of several records the one that has it; empty for all

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


_Found = TypeVar("_Found", NamedCause, Unexplained)


@dataclass(frozen=True, slots=True)
class Rest:
    """What the extended model leaves above the noise (contract section 5)."""

    heldout_rms_nm: float  # on blocks to which it was not fitted
    noise_rms_nm: float
    told: tuple[Unexplained, ...] = ()  # what accounts for the difference, where it is located


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Amplitudes of lines along one axis, without and with the causes; arrays of shape (m,)."""

    domain: str  # ``motor-order``, ``output-order`` or ``frequency``
    unit: str
    axis: FloatArray
    before_nm: FloatArray  # largest amplitude in the cell of each point
    after_nm: FloatArray


@dataclass(frozen=True, slots=True)
class Pictures:
    """Everything that a picture of the diagnosis needs; arrays of shape (n_samples,)."""

    time_s: FloatArray
    velocity_rad_s: FloatArray
    measured_nm: FloatArray  # NaN where lost
    simulated_nm: FloatArray  # by the model as it was handed in
    extended_nm: FloatArray  # as the torque channel passes it
    residual_before_nm: FloatArray  # measured less fitted baseline; NaN where not used
    residual_after_nm: FloatArray  # less baseline and causes
    masked: NDArray[np.bool_]  # samples that no fit used
    spectra: tuple[Spectrum, ...]
    acceleration_rad_s2: FloatArray
    motor_angle_rad: FloatArray
    output_angle_rad: FloatArray
    applied_nm: FloatArray  # the known torque through the flexspline


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
        listed = ("causes", "minor", "unexplained", "minor_unexplained", "data_flags", "left_out")
        return {
            **header,
            "verdict": self.verdict,
            "reason": self.reason,
            **{key: as_json(getattr(self, key)) for key in listed},
            "rest": as_json(self.rest),
            "testable": as_json(self.testable),
            "minimum_detectable": [
                {"name": name, "amplitude_nm": amplitude}
                for name, amplitude in self.minimum_detectable
            ],
            "simulated": dict(self.simulated),
            "extended": dict(self.extended),
            "model_file": model_file,
            "settings": dict(self.settings),
            "records": as_json(self.records),
        }


def data_bad(
    model: BenchModel,
    terms: Sequence[str],
    flags: tuple[DataFlag, ...],
    settings: Mapping[str, Any],
    reason: str,
    left_out: tuple[LeftOutSamples, ...] = (),
) -> Diagnosis:
    """Return the answer for a record of which nothing can be said."""
    nothing = {"terms": list(terms), "heldout_rms_nm": None}
    return Diagnosis(
        "data-bad", (), (), (), (), flags, (), nothing, nothing, model, settings, reason,
        left_out=left_out,
    )  # fmt: skip


def by_share(found: Sequence[_Found], least: float) -> tuple[tuple[_Found, ...], ...]:
    """Return what explains a share of the variance or more, and what explains less."""
    kept = tuple(one for one in found if one.share_of_variance >= least)
    return kept, tuple(one for one in found if one not in kept)


def verdict_of(causes: Sequence[NamedCause], places: Sequence[Unexplained]) -> str:
    """Return the verdict of the contract on what was found."""
    if causes and places:
        return "named-and-unexplained"
    if causes:
        return "named"
    return "unexplained" if places else "nothing-found"
