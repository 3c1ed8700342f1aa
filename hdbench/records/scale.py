"""The torque gain that turned volts into newton metres, and where it came from."""

from __future__ import annotations

from dataclasses import dataclass

from hdbench.records.quantity import Quantity

__all__ = ["TorqueScale"]


@dataclass(frozen=True, slots=True)
class TorqueScale:
    """A gain with its uncertainty and its origin.

    Parameters
    ----------
    gain_nm_per_v : Quantity
        Torque per amplified volt, N m/V.
    source : str
        ``calibration run <id>``, ``profile <name>`` or ``trace torque_nm column``.
    sha256 : str or None
        Hash of the calibration result, where it is a stored one.
    calibrated_utc : str or None
        When that calibration was made, ISO 8601; None where nothing tells it.
    age_days : float or None
        Its age when the run started, days.
    expired : bool
        True where it was older than the profile allows, and used knowingly.
    age_words : str
        The same for a person.
    """

    gain_nm_per_v: Quantity
    source: str
    sha256: str | None = None
    calibrated_utc: str | None = None
    age_days: float | None = None
    expired: bool = False
    age_words: str = ""

    @property
    def relative_std(self) -> float:
        """Standard uncertainty of the gain over the gain, dimensionless."""
        return self.gain_nm_per_v.std / abs(self.gain_nm_per_v.value)

    def to_dict(self) -> dict[str, object]:
        """Return the scale as results store it."""
        return {
            "gain_nm_per_v": self.gain_nm_per_v.to_dict(),
            "source": self.source,
            "sha256": self.sha256,
            "calibrated_utc": self.calibrated_utc,
            "age_days": self.age_days,
            "expired": self.expired,
            "age_words": self.age_words,
        }
