"""What an inspection says: facts of each channel, and findings with their consequence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

__all__ = ["ChannelFacts", "Coverage", "Finding", "Gap", "Inspection", "Sampling"]


@dataclass(frozen=True, slots=True)
class Finding:
    """Something about a log that limits what it can tell.

    Parameters
    ----------
    name : str
        What it is.
    channel : str or None
        Of which channel; None for the whole log.
    detail : str
        Its size, in words.
    consequence : str
        What follows, one line.
    """

    name: str
    channel: str | None
    detail: str
    consequence: str


@dataclass(frozen=True, slots=True)
class ChannelFacts:
    """One channel; None where it cannot be told.

    Parameters
    ----------
    name, unit : str
        Name and unit; empty text where no unit is stated.
    rate_hz : float or None
        New values per second.
    bandwidth_hz : float or None
        Frequency up to which it holds more than its rounding, Hz: half the rate where nothing
        limits it. None for an angle, which is an integral, and where there is no time.
    resolution : float or None
        Step of its values, in its unit; None where they lie on no grid that can be seen.
    noise : float or None
        Scatter of one sample by the floor of its spectrum, in its unit.
    missing_share, held_share : float
        Share of samples without a value, and of those that repeat the one before although the
        channel moves, in [0, 1].
    derived_from : str or None
        Channel of which it was computed.
    delay_s : float or None
        How much later than `delay_to` it is, s, its standard deviation and that channel.
    delay_std_s : float or None
        Standard deviation of it, s.
    delay_to : str or None
        The channel it is held against.
    """

    name: str
    unit: str
    rate_hz: float | None
    bandwidth_hz: float | None
    resolution: float | None
    noise: float | None
    missing_share: float
    held_share: float
    derived_from: str | None = None
    delay_s: float | None = None
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
    """Stamps of a log; None where it has none.

    Parameters
    ----------
    rows : int
        Samples.
    span_s : float or None
        From the first stamp to the last, s.
    median_s : float or None
        Median step, s.
    rate_hz : float or None
        Samples per second outside of gaps.
    jitter_share : float or None
        Root mean square deviation of the steps outside of gaps from their median, relative to it.
    repeated, backward : int
        Stamps equal to the one before, and stamps before the one before.
    even_beneath : bool or None
        Whether angle and velocity say that the samples were even although their stamps are not.
    gaps : tuple of Gap
        Missing samples.
    """

    rows: int
    span_s: float | None = None
    median_s: float | None = None
    rate_hz: float | None = None
    jitter_share: float | None = None
    repeated: int = 0
    backward: int = 0
    even_beneath: bool | None = None
    gaps: tuple[Gap, ...] = ()


@dataclass(frozen=True, slots=True)
class Coverage:
    """Motion that a log covers; speeds in the unit of its velocity.

    Parameters
    ----------
    unit : str
        Unit of the speeds; empty where none is stated.
    velocity : tuple of float
        Least and greatest velocity that one sample in a hundred passes.
    rest_share : float
        Share of samples at less than a twentieth of the greatest speed.
    reversals : int
        Changes of direction between speeds of more than that.
    turns : float or None
        Motor turns from the least to the greatest angle.
    limits : tuple of Finding
        What this motion cannot tell.
    """

    unit: str
    velocity: tuple[float, float]
    rest_share: float
    reversals: int
    turns: float | None
    limits: tuple[Finding, ...]


def _as_json(items: list[tuple[str, Any]]) -> dict[str, Any]:
    return {key: list(value) if isinstance(value, tuple) else value for key, value in items}


@dataclass(frozen=True, slots=True)
class Inspection:
    """What a log can tell.

    Parameters
    ----------
    source : str
        The log.
    sampling : Sampling
        Its stamps.
    channels : tuple of ChannelFacts
        Its channels.
    findings : tuple of Finding
        What limits it.
    coverage : Coverage or None
        Its motion; None where it has none.
    notes : tuple of str
        What was not looked at.
    spectra : mapping
        For pictures: frequency, Hz, and density, unit^2/Hz, of each channel that has one.
    """

    source: str
    sampling: Sampling
    channels: tuple[ChannelFacts, ...]
    findings: tuple[Finding, ...]
    coverage: Coverage | None
    notes: tuple[str, ...] = ()
    spectra: Mapping[str, Any] = field(default_factory=dict, compare=False)

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON holds it.

        Returns
        -------
        dict
            ``sampling``, ``channels``, ``coverage``, ``findings`` and ``notes``.
        """
        told = asdict(self, dict_factory=_as_json)
        return {key: told[key] for key in ("sampling", "channels", "coverage", "findings", "notes")}
