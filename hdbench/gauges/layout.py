"""Layout of the rosettes on the flexspline's diaphragm, and of the gauges in the bridge."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

# share of the flexspline's diameter that its boss takes where nobody gave it; ours, from drawings
# of cup-type flexsplines: every one is to be measured
_BOSS_SHARE = 0.44


@dataclass(frozen=True, slots=True)
class Rosette:
    """One pad with two grids at right angles, both at 45 degrees to the radius."""

    # 1, 2, ...; its gauges are R(2 number - 1) and R(2 number)
    number: int
    # angle on the diaphragm, degrees, counter-clockwise from the index mark
    angle_deg: float
    # false: the odd gauge sits nearer to the axis. True: the even one does
    reverse: bool

    @property
    def gauges(self) -> tuple[int, int]:
        """Numbers of the odd and the even gauge."""
        return 2 * self.number - 1, 2 * self.number


@dataclass(frozen=True, slots=True)
class Layout:
    """Rosettes of one bridge."""

    # name on the command line
    name: str
    # one line for a person
    words: str
    # an even number of them. The first, third, ... stand in series in arms 1 (odd gauges) and 2
    # (even gauges), the second, fourth, ... in arms 3 and 4
    rosettes: tuple[Rosette, ...]

    @property
    def angles_rad(self) -> tuple[float, ...]:
        """Angles of the rosettes, rad."""
        return tuple(math.radians(rosette.angle_deg) for rosette in self.rosettes)


def _layout(name: str, words: str, angles: tuple[float, ...], reverse: tuple[bool, ...]) -> Layout:
    placed = zip(angles, reverse, strict=True)
    return Layout(name, words, tuple(Rosette(i, a, r) for i, (a, r) in enumerate(placed, start=1)))


# figure 2 of CIM-TR-97-06: four rosettes at right angles, R5 and R6 "in the reverse position" of
# R1 and R2; equations 1 to 4 need the first two only
LAYOUTS = {
    layout.name: layout
    for layout in (
        _layout(
            "four",
            "four rosettes 90 degrees apart, the third and fourth reversed (the report's figure 2)",
            (0.0, 90.0, 180.0, 270.0),
            (False, False, True, True),
        ),
        _layout(
            "two",
            "two rosettes 90 degrees apart (the report's equations 1 to 4)",
            (0.0, 90.0),
            (False, False),
        ),
        _layout(
            "spread",
            "four rosettes 45 degrees apart: cancels orders 2 and 4",
            (0.0, 45.0, 90.0, 135.0),
            (False, True, False, True),
        ),
    )
}


@dataclass(frozen=True, slots=True)
class GridGeometry:
    """Where the two grids of a rosette are.

    Parameters
    ----------
    radius_mm : float
        Distance of the rosette's centre from the axis, mm, above 0.
    spacing_mm : float
        Distance between the centres of its two grids along the radius, mm, at least 0 and less
        than twice the radius.
    """

    radius_mm: float
    spacing_mm: float


def cancellation(layout: Layout, order: float) -> float:
    r"""Return the share of an order of the wave strain that the bridge still sees.

    Parameters
    ----------
    layout : Layout
        The rosettes.
    order : float
        Cycles per turn of the wave generator against the flexspline.

    Returns
    -------
    float
        0: the rosettes cancel it. 1: all of them see it at one phase, it stays in full.

    Notes
    -----
    :math:`|\frac{1}{n} \sum_i e^{-j m \theta_i}|`: rosette i at :math:`\theta_i` sees the wave
    :math:`\Psi_m \sin m (\beta - \theta_i)`, and the bridge averages. At right angles order 2 is
    turned by 180 degrees from one rosette to the next, order 4 by 360.

    Examples
    --------
    >>> two = LAYOUTS["two"]
    >>> round(cancellation(two, 2), 12), round(cancellation(two, 4), 12)
    (0.0, 1.0)
    """
    phasors = [cmath.exp(-1j * order * angle) for angle in layout.angles_rad]
    return abs(sum(phasors)) / len(phasors)


def usual_places(diameter_mm: float, boss_mm: float | None = None) -> tuple[float, float]:
    """Return where rosettes go on a diaphragm of which nobody gave the boss.

    Parameters
    ----------
    diameter_mm : float
        Flexspline diameter, mm.
    boss_mm : float or None
        Diameter of its boss, mm; None takes 0.44 of the diameter, in half millimetres.

    Returns
    -------
    boss_mm : float
        Diameter of the boss, mm.
    radius_mm : float
        Midway between boss and rim, mm.
    """
    boss = round(2.0 * _BOSS_SHARE * diameter_mm) / 2.0 if boss_mm is None else boss_mm
    return boss, 0.25 * (diameter_mm + boss)
