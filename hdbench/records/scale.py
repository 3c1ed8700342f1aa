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
    """

    gain_nm_per_v: Quantity
    source: str
    sha256: str | None = None

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
        }
