"""A part of the residual that has a place and no name."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Left"]


@dataclass(frozen=True, slots=True)
class Left:
    """A part of the residual that has a place and no name.

    Parameters
    ----------
    domain : str
        Domain of the contract.
    unit : str
        Unit of the place.
    location : float
        Centre of the place.
    extent : tuple of float
        Its ends.
    size_nm : float
        Size of the effect there, N m.
    p_value : float
        Probability of the statistic or more without it, for this challenger alone.
    variance_nm2 : float
        Its part of the residual's variance, (N m)^2.
    """

    domain: str
    unit: str
    location: float
    extent: tuple[float, float]
    size_nm: float
    p_value: float
    variance_nm2: float
