"""Result of a diagnosis: causes, places without a name, and what the record can tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Self

from pydantic import NonNegativeFloat

from hdbench.results.parts import Part, ProfileName, Scale, key, listed, optional


class ParameterValue(Part, kw_only=False):
    """A parameter of a cause."""

    value: float = key("its value")
    std: NonNegativeFloat | None = key("standard uncertainty; none where it is not known")
    unit: str = key("its unit; 1 for a ratio")


def parameter_values(table: Mapping[str, Mapping[str, Any]]) -> dict[str, ParameterValue]:
    """Return the parameters of a cause as the model room states them."""
    return {name: ParameterValue(**entry) for name, entry in table.items()}


class Gain(Part, kw_only=False):
    """Held-out residual without and with a cause."""

    heldout_rms_before_nm: float = key("without the cause", "N m")
    heldout_rms_after_nm: float = key("with it", "N m")
    explained_fraction: float = key("one less the ratio of the mean squares")
    interval: tuple[float, float] = key("95 % interval of it by a paired block bootstrap")


class Voice(Part, kw_only=False):
    """What one of several records says of a cause."""

    record: str = key("its name")
    evidence_nats: float = key("by how much its likelihood falls without the cause")
    gain: Gain = key("held-out residual of this record without and with the cause")
    parameters: dict[str, ParameterValue] = key("as this record alone has them; may be empty")
    disagrees: bool = key("whether they are not those of the other records")


class Disagreement(Part):
    """Records that differ about a cause."""

    records: tuple[str, ...] = key("their names")
    false_alarm_probability: float | None = key("chance that records which share it differ so far")


class NamedCause(Part):
    """A cause with a name of the catalogue."""

    name: str = key("name in the catalogue")
    group: tuple[str, ...] = key("names that these data cannot tell from it, its own first")
    rivals: tuple[str, ...] = listed("other names within 3 nats")
    parameters: dict[str, ParameterValue] = key("value, std and unit of each parameter")
    evidence_nats: float = key("log of the evidence for the name against no effect")
    probability: float | None = optional("share of the group in the evidence of all names")
    false_alarm_probability: float = key(
        "chance of this evidence anywhere on a record without an effect"
    )
    gain: Gain = key("held-out rms before and after, explained fraction with its interval")
    separating_experiment: str | None = optional("run that tells it from its rivals")
    share_of_variance: float = key("share of the baseline's residual variance")
    domain: str = key("axis on which it is plainest")
    held_out_conditions: tuple[str, ...] = listed("always empty")
    voices: tuple[Voice, ...] = key(
        "of records together: what each says of the cause", name="records", default=(), absent=True
    )
    disagreement: Disagreement | None = optional(
        "of records together: those that differ about it", absent=True
    )

    def heard(self, voices: Sequence[Voice], apart_chance: float | None = None) -> Self:
        """Return the cause with what each record says of it."""
        apart = tuple(one.record for one in voices if one.disagrees)
        told = Disagreement(records=apart, false_alarm_probability=apart_chance)
        return replace(self, voices=tuple(voices), disagreement=told)


class Unexplained(Part):
    """A part of the residual with a place and no name."""

    domain: str = key("axis on which it stands")
    second_domain: str | None = optional("other axis where it depends on two")
    location: float = key("its centre")
    extent: tuple[float, float] = key("its ends; of a line its 95 % interval")
    unit: str = key("unit of place and ends")
    size_nm: float = key("its size", "N m")
    share_of_variance: float = key("share of the baseline's residual variance")
    false_alarm_probability: float = key(
        "chance of it anywhere on a record without an effect", default=0.0
    )
    record: str = key("of records together the one that has it", default="", absent=True)


class StretchFlag(Part, kw_only=False):
    """A stretch of doubtful samples."""

    name: str = key("what was found")
    from_s: float = key("first stamp", "s")
    to_s: float = key("last stamp", "s")
    samples: int = key("samples that it concerns")
    detail: str = key("the same in words", default="", absent=True)
    record: str = key("of records together the one that has it", default="", absent=True)


class LeftOutSamples(Part, kw_only=False):
    """Samples that took no part, for one reason."""

    reason: str = key("why, in a few words")
    samples: int = key("how many")
    share: float = key("of all samples")


class Rest(Part, kw_only=False):
    """What the extended model leaves above the noise."""

    heldout_rms_nm: float = key("what the extended model leaves on held-out blocks", "N m")
    noise_rms_nm: float = key("what the noise alone would leave", "N m")
    told: tuple[Unexplained, ...] = listed("entries of unexplained that account for the difference")


class Testable(Part, kw_only=False):
    """Whether a record can show one cause of the catalogue."""

    name: str = key("name in the catalogue")
    testable: bool = key("whether an effect of this name would be seen")
    because: str = key("why not, or what of it not; may be empty", default="")


class Detectable(Part, kw_only=False):
    """Smallest effect of a name that a record would have shown."""

    name: str = key("name in the catalogue")
    amplitude_nm: float = key("would have been found with 90 % probability", "N m")


class ModelFit(Part):
    """A model held against the record."""

    terms: tuple[str, ...] = listed("its terms")
    heldout_rms_nm: float | None = optional("what it leaves on held-out blocks", "N m")
    as_given_rms_nm: float | None = optional(
        "what it leaves with the numbers it was handed in with", "N m", absent=True
    )


_NO_FIT = ModelFit()


class HeldOut(Part, kw_only=False):
    """What a model leaves of one of several records."""

    heldout_rms_nm: float | None = key("what it leaves on held-out blocks", "N m")


class DiagnosedPart(Part, kw_only=False):
    """Part of a longer record that was diagnosed."""

    from_s: float = key("first stamp", "s")
    to_s: float = key("last stamp", "s")
    samples: int = key("its samples")
    of_samples: int = key("samples of the whole record")
    cut: bool = key("whether it ends there because one diagnosis takes no more samples")


class RecordPart(Part):
    """The part of one record in a diagnosis of several."""

    record: str = key("its name")
    left_out: str | None = optional("why it took no part")
    samples: int = key("samples used")
    rate_hz: float = key("sampling rate", "Hz")
    simulated: HeldOut = key("its baseline alone", default=HeldOut(None))
    extended: HeldOut = key("the extended model", default=HeldOut(None))
    noise_rms_nm: float | None = optional("its noise", "N m")
    disagrees: tuple[str, ...] = listed("causes about which it differs from the other records")
    settings: dict[str, Any] = key(
        "its noise, torque channel and form errors; empty where it took no part"
    )
    input: str | None = optional("file", absent=True)
    input_sha256: str | None = optional("its SHA-256", absent=True)
    imported: dict[str, Any] | None = optional("where an imported record comes from", absent=True)
    torque_scale: Scale | None = optional("gain that scaled its torque, and where it is from")
    part: DiagnosedPart | None = optional("what was diagnosed of a longer record")
    inspection: dict[str, Any] | None = optional(
        "what its log can tell, as `hdbench inspect` gives it"
    )


class BeforeAfter(Part, kw_only=False):
    """A torque of the filter's output without and with its new blocks."""

    before: float = key("without the new blocks", "N m")
    after: float = key("with them", "N m")


class GainedBlock(Part):
    """A block that the filter gains."""

    order: float = key("cycles per motor turn")
    role: str = key("ripple or misalignment")
    amplitude_nm: BeforeAfter = key("at its order in the filtered torque", "N m")


class FilterGain(Part):
    """Filtered torque without and with the orders that were found as blocks."""

    model: str = key("name of the filter with the new blocks")
    from_s: float = key("time after which the filter had settled", "s")
    error_rms_nm: BeforeAfter = key(
        "filtered torque less the extended model without the lines that blocks take", "N m"
    )
    blocks: tuple[GainedBlock, ...] = key("the new ones")


class SeparatingRun(Part):
    """The run that settles what is open."""

    file: str | None = key("its plan in the run folder; none where no run of this bench does")
    words: tuple[str, ...] = key("what each block of it is for")


class DiagnosisResult(Part):
    """Measured against simulated: causes, places without a name, and the extended model."""

    schema: str = key("hdbench/KIND/1", default="hdbench/diagnosis/1")
    hdbench_version: str = key("version that wrote it", default="")
    profile: ProfileName | None = optional("name and SHA-256 of the profile")
    verdict: str = key(
        "nothing-found, named, unexplained, named-and-unexplained, data-bad or cannot-tell"
    )
    reason: str = key("why no more can be said; may be empty", default="")
    causes: tuple[NamedCause, ...] = listed("causes that matter")
    minor: tuple[NamedCause, ...] = listed("significant causes below the materiality")
    unexplained: tuple[Unexplained, ...] = listed("structure that no cause explains")
    minor_unexplained: tuple[Unexplained, ...] = listed("the same below the materiality")
    data_flags: tuple[StretchFlag, ...] = listed("faults of the data")
    left_out: tuple[LeftOutSamples, ...] = listed("samples that took no part")
    rest: Rest | None = optional("what the extended model leaves above the noise")
    testable: tuple[Testable, ...] = listed("each name of the catalogue: can this record show it")
    minimum_detectable: tuple[Detectable, ...] = listed(
        "smallest effects that would have been found"
    )
    simulated: ModelFit = key("terms and held-out rms of the model", default=_NO_FIT)
    extended: ModelFit = key("terms and held-out rms of the extended model", default=_NO_FIT)
    model_file: str | None = optional("the extended model")
    settings: dict[str, Any] = key("what the diagnosis ran with", default={})
    records: tuple[RecordPart, ...] = listed(
        "records that were diagnosed together; empty for one alone"
    )
    input: str = key("file that was diagnosed", default="")
    input_sha256: str = key("its SHA-256", default="")
    imported: dict[str, Any] | None = optional("where an imported record comes from", absent=True)
    torque_scale: Scale | None = optional("gain that scaled the torque, and where it is from")
    part: DiagnosedPart | None = optional("what was diagnosed of a longer record")
    inspection: dict[str, Any] | None = optional(
        "what the log can tell, as `hdbench inspect` gives it"
    )
    filter_gain: FilterGain | None = optional("what the extended model spares the filter")
    separating_run: SeparatingRun | None = optional("plan of the run that settles what is open")
