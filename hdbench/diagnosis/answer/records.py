"""Small records of an answer: gains, flags, conditions, samples left out, what could be told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Condition",
    "DataFlag",
    "Gain",
    "LeftOut",
    "LeftOutSamples",
    "RecordPart",
    "Testable",
    "Voice",
]

# the other conditions foretell a condition that can tell to a tenth of what the cause claims in it,
# and it speaks against the cause where the prediction is worse with it by three deviations
FORETOLD = 0.1
_LOST = 9.0


@dataclass(frozen=True, slots=True)
class Gain:
    """Held-out residual without and with a cause.

    Parameters
    ----------
    heldout_rms_before_nm, heldout_rms_after_nm : float
        Root mean square without and with it, N m.
    explained_fraction : float
        One less the ratio of the mean squares.
    interval : tuple of float
        95 % interval of `explained_fraction` by a paired block bootstrap.
    """

    heldout_rms_before_nm: float
    heldout_rms_after_nm: float
    explained_fraction: float
    interval: tuple[float, float]

    def to_dict(self) -> dict[str, object]:
        """Return the gain as the contract writes it."""
        return {
            "heldout_rms_before_nm": self.heldout_rms_before_nm,
            "heldout_rms_after_nm": self.heldout_rms_after_nm,
            "explained_fraction": self.explained_fraction,
            "interval": list(self.interval),
        }


@dataclass(frozen=True, slots=True)
class Condition:
    """Samples of one level of speed or load, or of one direction.

    Parameters
    ----------
    axis : str
        ``velocity``, ``direction`` or ``torque``.
    unit : str
        Unit of the range.
    low, high : float
        Range of its samples; -1 or 1 for a direction.
    inside : ndarray of bool, shape (n,)
        Samples.
    """

    axis: str
    unit: str
    low: float
    high: float
    inside: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class LeftOut:
    """What a cause gains in a condition from which it was not fitted.

    Parameters
    ----------
    condition : Condition
        Condition.
    gain_nats : float
        Log likelihood gained there by the cause as the other conditions have it.
    claimed_nats : float
        The same of the cause as all conditions have it, without noise.
    """

    condition: Condition
    gain_nats: float
    claimed_nats: float

    @property
    def against(self) -> bool:
        """True where the condition speaks against the cause."""
        return self.gain_nats < -0.5 * max(_LOST, FORETOLD * 2.0 * self.claimed_nats)

    def to_dict(self) -> dict[str, object]:
        """Return it as a JSON object."""
        return {
            "axis": self.condition.axis,
            "unit": self.condition.unit,
            "range": [self.condition.low, self.condition.high],
            "gain_nats": self.gain_nats,
            "claimed_nats": self.claimed_nats,
        }


@dataclass(frozen=True, slots=True)
class Voice:
    """What one of several records says of a cause.

    Parameters
    ----------
    record : str
        Name of the record.
    evidence_nats : float
        By how much the likelihood of this record falls without the cause, nats; below 0 where it
        speaks against it.
    gain : Gain
        Held-out residual of this record without and with the cause.
    parameters : mapping
        Its sizes as this record alone has them, beside all that is shared: name to ``{"value",
        "std", "unit"}``; empty where the record does not show them.
    disagrees : bool
        Whether they are not those of the other records.
    """

    record: str
    evidence_nats: float
    gain: Gain
    parameters: Mapping[str, Mapping[str, Any]]
    disagrees: bool

    def to_dict(self) -> dict[str, object]:
        """Return it as a JSON object."""
        return {
            "record": self.record,
            "evidence_nats": self.evidence_nats,
            "gain": self.gain.to_dict(),
            "parameters": {name: dict(entry) for name, entry in self.parameters.items()},
            "disagrees": self.disagrees,
        }


@dataclass(frozen=True, slots=True)
class RecordPart:
    """The part of one record in a diagnosis of several.

    Parameters
    ----------
    record : str
        Its name.
    left_out : str
        Why it took no part; empty where it did.
    samples : int
        Samples that were used.
    rate_hz : float
        Its sampling rate, Hz.
    simulated_rms_nm, extended_rms_nm : float or None
        Held-out residual with its baseline alone, and with all causes, N m; None if left out.
    noise_rms_nm : float or None
        Its noise, N m; None if left out.
    disagrees : tuple of str
        Causes about which it does not say what the others say.
    settings : mapping
        Its noise, channel and form errors, as `settings` of a diagnosis of it alone.
    """

    record: str
    left_out: str
    samples: int
    rate_hz: float
    simulated_rms_nm: float | None = None
    extended_rms_nm: float | None = None
    noise_rms_nm: float | None = None
    disagrees: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)

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
    """A stretch of doubtful samples.

    Parameters
    ----------
    name : str
        ``missed-samples``, ``saturation``, ``spikes``, ``stuck-value``, ``quantisation``,
        ``encoder-slip``, ``tacho-ripple``, ``speed-dependent-noise``, ``encoder-scale``,
        ``velocity-scale`` or ``wrong-channel``.
    from_s, to_s : float
        First and last of them, s.
    samples : int
        How many.
    detail : str
        One sentence for a person, with numbers and units; may be empty.
    record : str
        Of several records the one that has them; empty for one alone.
    """

    name: str
    from_s: float
    to_s: float
    samples: int
    detail: str = ""
    record: str = ""

    def to_dict(self) -> dict[str, object]:
        """Return the flag as the contract writes it."""
        plain: dict[str, object] = {
            "name": self.name,
            "from_s": self.from_s,
            "to_s": self.to_s,
            "samples": self.samples,
        }
        more = {"detail": self.detail, "record": self.record}
        return {**plain, **{key: words for key, words in more.items() if words}}


@dataclass(frozen=True, slots=True)
class LeftOutSamples:
    """Samples that took no part in a diagnosis, for one reason.

    Parameters
    ----------
    reason : str
        A few plain words: "the acceleration is not resolved here".
    samples : int
        How many.
    share : float
        Of all samples of the record, in [0, 1].
    """

    reason: str
    samples: int
    share: float

    def to_dict(self) -> dict[str, object]:
        """Return it as the contract writes it."""
        return {"reason": self.reason, "samples": self.samples, "share": self.share}


@dataclass(frozen=True, slots=True)
class Testable:
    """Whether a record can show one cause of the catalogue.

    Parameters
    ----------
    name : str
        Name of the cause.
    testable : bool
        True where an effect of this name would be seen.
    because : str
        Why it would not, or what of it would not, with numbers and units; may be empty.
    """

    name: str
    testable: bool
    because: str = ""

    def to_dict(self) -> dict[str, object]:
        """Return it as the contract writes it."""
        return {"name": self.name, "testable": self.testable, "because": self.because}
