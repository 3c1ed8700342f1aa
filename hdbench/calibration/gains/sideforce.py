"""Side force and true difference of direction: told apart only where the data can."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.records.quantity import Quantity

__all__ = ["DirectionEffects", "DirectionEntry", "direction_effects"]

# levers 1/L that differ by less than this share of the largest are one lever
_SAME_LEVER = 0.02


@dataclass(frozen=True, slots=True)
class DirectionEntry:
    """Sensitivity of one experiment and how its torque was applied.

    Parameters
    ----------
    position : int
        Number of the flexspline position.
    direction : str
        ``cw`` or ``ccw``.
    sensitivity_v_per_nm : float
        Volts per newton metre, by the experiment's line.
    lever_per_m : float
        Side force over torque, 1/m: 1 over the arm's length; 0 for a couple.
    """

    position: int
    direction: str
    sensitivity_v_per_nm: float
    lever_per_m: float


@dataclass(frozen=True, slots=True)
class DirectionEffects:
    """What the difference of the directions is made of.

    Parameters
    ----------
    separated : bool
        Whether the two causes below are told apart.
    group : tuple of str
        Causes that cannot be told apart on these data.
    reason : str
        Why.
    crosstalk_v_per_n : Quantity or None
        Reading per side force, V/N.
    asymmetry : Quantity or None
        Half the true difference of sensitivity over its mean, cw positive.
    """

    separated: bool
    group: tuple[str, ...]
    reason: str
    crosstalk_v_per_n: Quantity | None = None
    asymmetry: Quantity | None = None

    def to_dict(self) -> dict[str, object]:
        """Return the effects as results store them."""
        force, true = self.crosstalk_v_per_n, self.asymmetry
        return {
            "separated": self.separated,
            "group": list(self.group),
            "reason": self.reason,
            "crosstalk_v_per_n": None if force is None else force.to_dict(),
            "half_asymmetry": None if true is None else true.to_dict(),
        }


_BOTH = ("side-force", "direction-asymmetry")


def direction_effects(entries: Sequence[DirectionEntry]) -> DirectionEffects:
    """Separate side force from a true difference of the directions, where the data allow it.

    Parameters
    ----------
    entries : sequence of DirectionEntry
        One per experiment.

    Returns
    -------
    DirectionEffects

    Notes
    -----
    ``V/T = S_position + s (d + c l)``, s = +1 clockwise and -1 anticlockwise, l the lever 1/L (0
    for a couple). The side force of a single arm always points down and the torque changes its
    sign, so that c and d have the same signature for one lever; a second arm length or a couple
    separates them. Least squares with one S for each position.
    """
    levers = [e.lever_per_m for e in entries]
    directions = {e.direction for e in entries}
    if len(directions) < 2:
        return DirectionEffects(False, _BOTH, "one direction only: neither can be seen")
    both = [
        lever
        for lever in _distinct(levers)
        if {e.direction for e in entries if _same(e.lever_per_m, lever, max(levers))} == directions
    ]
    if len(both) < 2:
        reason = "one arm length and no couple: both change sign with the direction alike"
        return DirectionEffects(False, _BOTH, reason)
    places = sorted({e.position for e in entries})
    sign = np.array([1.0 if e.direction == "cw" else -1.0 for e in entries])
    design = np.column_stack(
        [
            *(np.array([e.position == p for e in entries], dtype=float) for p in places),
            sign,
            sign * np.array(levers),
        ]
    )
    y = np.array([e.sensitivity_v_per_nm for e in entries])
    free = len(y) - design.shape[1]
    if free < 1 or np.linalg.matrix_rank(design) < design.shape[1]:
        return DirectionEffects(False, _BOTH, "too few experiments to separate the two")
    found = np.linalg.lstsq(design, y, rcond=None)[0]
    left = y - design @ found
    covariance = np.linalg.inv(design.T @ design) * float(left @ left) / free
    mean, k = float(found[: len(places)].mean()), len(places)
    if mean == 0.0:
        return DirectionEffects(False, _BOTH, "the sensitivities of the positions cancel")
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return DirectionEffects(
        True,
        (),
        f"{len(both)} ways of loading in both directions",
        Quantity(float(found[k + 1]), float(std[k + 1]), float(free)),
        Quantity(float(found[k]) / mean, float(std[k]) / abs(mean), float(free)),
    )


def _same(one: float, two: float, largest: float) -> bool:
    return abs(one - two) <= _SAME_LEVER * largest


def _distinct(levers: Sequence[float]) -> list[float]:
    kept: list[float] = []
    for lever in levers:
        if not any(_same(lever, other, max(levers)) for other in kept):
            kept.append(lever)
    return kept
