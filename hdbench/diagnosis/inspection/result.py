"""Result of an inspection: facts of each channel, and findings with their consequence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Finding:
    """Something about a log that limits what it can tell."""

    name: str
    channel: str | None  # None for the whole log
    detail: str  # its size, in words
    consequence: str  # what follows, one line


@dataclass(frozen=True, slots=True)
class ChannelFacts:
    """One channel; None where it cannot be told."""

    name: str
    unit: str  # empty where none is stated
    rate_hz: float | None  # new values per second
    # up to where it holds more than its rounding: half the rate where nothing limits it; None for
    # an angle, which is an integral, and where there is no time
    bandwidth_hz: float | None
    resolution: float | None  # step of its values, in its unit
    noise: float | None  # scatter of one sample by the floor of its spectrum, in its unit
    missing_share: float  # samples without a value
    held_share: float  # samples that repeat the one before although the channel moves
    derived_from: str | None = None  # channel of which it was computed
    delay_s: float | None = None  # how much later than `delay_to` it is
    delay_std_s: float | None = None
    delay_to: str | None = None


@dataclass(frozen=True, slots=True)
class Gap:
    """Samples that are missing: the last stamp before, the first after, and how many."""

    from_s: float
    to_s: float
    samples: int


@dataclass(frozen=True, slots=True)
class Sampling:
    """Stamps of a log; None where it has none."""

    rows: int
    span_s: float | None = None
    median_s: float | None = None  # step
    rate_hz: float | None = None  # samples per second outside of gaps
    jitter_share: float | None = None  # RMS deviation of the steps from their median, relative
    repeated: int = 0  # stamps equal to the one before
    backward: int = 0  # stamps before the one before
    even_beneath: bool | None = None  # whether the samples were even although the stamps are not
    gaps: tuple[Gap, ...] = ()


@dataclass(frozen=True, slots=True)
class Coverage:
    """Motion that a log covers; speeds in the unit of its velocity."""

    unit: str  # empty where none is stated
    velocity: tuple[float, float]  # least and greatest that one sample in a hundred passes
    rest_share: float  # samples at less than a twentieth of the greatest speed
    reversals: int  # changes of direction between speeds of more than that
    turns: float | None  # motor turns from the least to the greatest angle
    limits: tuple[Finding, ...]  # what this motion cannot tell


@dataclass(frozen=True, slots=True)
class Inspection:
    """Sampling, channels, findings and motion of a log: all that limits what it can tell."""

    source: str
    sampling: Sampling
    channels: tuple[ChannelFacts, ...]
    findings: tuple[Finding, ...]
    coverage: Coverage | None  # None where it has no motion
    notes: tuple[str, ...] = ()  # what was not looked at
    # for pictures: frequency, Hz, and density, unit^2/Hz, of each channel that has one
    spectra: Mapping[str, Any] = field(default_factory=dict, compare=False)

    def to_dict(self) -> dict[str, Any]:
        """Return sampling, channels, coverage, findings and notes, for JSON."""
        told = asdict(self)
        return {key: told[key] for key in ("sampling", "channels", "coverage", "findings", "notes")}
