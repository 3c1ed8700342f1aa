"""How far rosettes may be from their places."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from hdbench.errors import UsageError

__all__ = ["Tolerance"]


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far a rosette may be from its place.

    Parameters
    ----------
    radial_mm : float
        Along the radius, +- mm.
    circumferential_deg, angular_deg : float
        Along the circumference, and turned about its own centre, +- degrees.
    off_centre_mm : float
        The film with all rosettes on it, from the axis in any direction, mm.
    distribution : {"uniform", "normal"}
        Uniform within the tolerance, or normal with the tolerance as two standard deviations.
    """

    radial_mm: float
    circumferential_deg: float
    angular_deg: float
    off_centre_mm: float = 0.0
    distribution: Literal["uniform", "normal"] = "uniform"

    def __post_init__(self) -> None:
        # beyond 20 degrees neighbouring pads touch and small-angle words lose their meaning
        for name, value, most in (
            ("--radial", self.radial_mm, math.inf),
            ("--circumferential", self.circumferential_deg, 20.0),
            ("--angular", self.angular_deg, 20.0),
            ("--off-centre", self.off_centre_mm, math.inf),
        ):
            if not (0.0 <= value <= most and math.isfinite(value)):
                unit = "mm" if most == math.inf else "degrees"
                limit = "" if most == math.inf else f" and at most {most:g}"
                raise UsageError(
                    f"tolerance {value!r} {unit}; needed: at least 0{limit}",
                    where=name,
                    fix="give how far a rosette may be off, such as 1",
                )

    def of(self, kind: str) -> float:
        """Return the tolerance of one kind in the unit of computation.

        Parameters
        ----------
        kind : str
            ``radial`` (mm), ``circumferential`` or ``angular`` (rad).

        Returns
        -------
        float
        """
        if kind == "radial":
            return self.radial_mm
        return math.radians(getattr(self, f"{kind}_deg"))
