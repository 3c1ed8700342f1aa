"""A number with its uncertainty, and the torque gain as one."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass


def coverage_factor(dof: float | None, confidence: float = 0.95) -> float:
    """Return k of a two-sided interval, by Student's t; by the normal distribution without dof."""
    from scipy.special import ndtri, stdtrit

    p = 0.5 + confidence / 2.0
    return float(ndtri(p)) if dof is None else float(stdtrit(dof, p))


@dataclass(frozen=True, slots=True)
class Quantity:
    """One measured number, its standard uncertainty and degrees of freedom.

    Parameters
    ----------
    value : float
        The estimate, in the unit that the key which holds it names.
    std : float
        Standard uncertainty, same unit, at least zero.
    dof : float or None
        Degrees of freedom of `std`; None where `std` is taken as known.

    Raises
    ------
    ValueError
        If a part is not finite, or `std` or `dof` is out of its domain.
    """

    value: float
    std: float
    dof: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.value) and math.isfinite(self.std) and self.std >= 0.0):
            raise ValueError(f"value {self.value!r} and std {self.std!r} must be finite, std >= 0")
        if self.dof is not None and not (math.isfinite(self.dof) and self.dof > 0.0):
            raise ValueError(f"dof {self.dof!r} must be positive and finite, or None")

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Return the two-sided interval at `confidence` with the quantity's own dof.

        Parameters
        ----------
        confidence : float
            Coverage probability, in (0, 1).

        Returns
        -------
        tuple of float
            Lower and upper end, unit of `value`.

        Notes
        -----
        Student's t with `dof` degrees of freedom; the normal distribution where `dof` is None.
        """
        k = coverage_factor(self.dof, confidence)
        return self.value - k * self.std, self.value + k * self.std

    def times(self, factor: float) -> Quantity:
        """Return the quantity times a number that is known, such as 2 for a peak to peak."""
        return Quantity(self.value * factor, self.std * abs(factor), self.dof)

    def to_dict(self) -> dict[str, float | None]:
        """Return ``{"value", "std", "dof"}`` as the contract writes it."""
        return asdict(self)


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
        return asdict(self)
