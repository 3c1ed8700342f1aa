"""Differences between gains: directions, ranges, side force, scatter beyond own uncertainties."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.calibration.gains import position_numbers
from hdbench.calibration.lever import AppliedTorque
from hdbench.calibration.readings import TakenReading
from hdbench.profile.calibrating import Arm
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import Quantity
from hdbench.results import calibration as record

# means of both levels that cancel to this share of either have no relative difference
_CANCELLED = 1e-9
# steps that bring the variance of Paule and Mandel to rounding: it converges quadratically
_STEPS = 60
# levers 1/L that differ by less than this share of the largest are one lever
_SAME_LEVER = 0.02
_BOTH = ("side-force", "direction-asymmetry")


def paired_difference(
    entries: Sequence[tuple[Hashable, str, float]], first: str, second: str
) -> record.PairedDifference | None:
    """Compare two levels over the pairs that have both.

    Notes
    -----
    Gains of one level of one pair are averaged. ``t = mean / (s / sqrt(n))`` with n - 1 dof: what
    a pair shares, the position above all, is not in s.
    """
    from scipy.special import stdtr

    pairs: dict[Hashable, dict[str, list[float]]] = {}
    for shared, level, gain in entries:
        pairs.setdefault(shared, {}).setdefault(level, []).append(gain)
    both = [p for p in pairs.values() if first in p and second in p]
    if len(both) < 2:
        return None
    one = np.array([math.fsum(p[first]) / len(p[first]) for p in both])
    two = np.array([math.fsum(p[second]) / len(p[second]) for p in both])
    apart = one - two
    sizes = float(np.mean(np.abs(one)) + np.mean(np.abs(two)))
    if not abs(float(one.mean() + two.mean())) > _CANCELLED * sizes:
        return None
    mean, std = float(apart.mean()), float(apart.std(ddof=1)) / math.sqrt(len(both))
    dof = float(len(both) - 1)
    statistic = mean / std if std > 0.0 else None
    total = float(one.mean()) + float(two.mean())
    return record.PairedDifference(
        first=first,
        second=second,
        mean_first_nm_per_v=float(one.mean()),
        mean_second_nm_per_v=float(two.mean()),
        difference_nm_per_v=Quantity(mean, std, dof),
        relative=Quantity(2.0 * mean / total, std / (abs(total) / 2.0), dof),
        t_statistic=statistic,
        probability=None if statistic is None else 2.0 * float(stdtr(dof, -abs(statistic))),
        n_pairs=len(both),
    )


def consensus(gains: Sequence[float], stds: Sequence[float]) -> record.Consensus | None:
    """Weigh gains by their own uncertainties and find what these do not explain.

    Notes
    -----
    ``sum (G_i - G)^2 / (u_i^2 + tau^2) = n - 1`` is solved for tau^2 by Newton's steps; the
    Birge ratio is ``sqrt(sum (G_i - G_w)^2 / u_i^2 / (n - 1))``.

    References
    ----------
    .. [1] R. C. Paule, J. Mandel, J. Res. NBS 87 (1982) 377, doi:10.6028/jres.087.022.
    """
    y, own = np.asarray(gains, dtype=float), np.asarray(stds, dtype=float) ** 2
    n = len(y)
    if n < 2 or not (own > 0.0).all():
        return None
    chi_square = float(_weighted(y, 1.0 / own)[1])
    extra = 0.0
    for _ in range(_STEPS):
        weights = 1.0 / (own + extra)
        mean, total = _weighted(y, weights)
        over = total - (n - 1)
        if not over > 0.0:
            break
        extra += over / float((weights**2 * (y - mean) ** 2).sum())
    weights = 1.0 / (own + extra)
    mean = _weighted(y, weights)[0]
    return record.Consensus(
        birge_ratio=math.sqrt(chi_square / (n - 1)),
        chi_square=chi_square,
        between_std_nm_per_v=math.sqrt(extra),
        weighted_mean_nm_per_v=Quantity(mean, 1.0 / math.sqrt(float(weights.sum())), float(n - 1)),
    )


def _weighted(y: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    mean = float((weights * y).sum() / weights.sum())
    return mean, float((weights * (y - mean) ** 2).sum())


@dataclass(frozen=True, slots=True)
class DirectionEntry:
    """Sensitivity of one experiment and how its torque was applied."""

    # number of the flexspline position
    position: int
    # `cw` or `ccw`
    direction: str
    # volts per newton metre, by the experiment's line
    sensitivity_v_per_nm: float
    # side force over torque, 1/m: 1 over the arm's length; 0 for a couple
    lever_per_m: float


def direction_effects(entries: Sequence[DirectionEntry]) -> record.DirectionEffects:
    """Separate side force from a true difference of the directions, where the data allow it.

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
        return _together("one direction only: neither can be seen")
    both = [
        lever
        for lever in _distinct(levers)
        if {e.direction for e in entries if _same(e.lever_per_m, lever, max(levers))} == directions
    ]
    if len(both) < 2:
        reason = "one arm length and no couple: both change sign with the direction alike"
        return _together(reason)
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
        return _together("too few experiments to separate the two")
    found = np.linalg.lstsq(design, y, rcond=None)[0]
    left = y - design @ found
    covariance = np.linalg.inv(design.T @ design) * float(left @ left) / free
    mean, k = float(found[: len(places)].mean()), len(places)
    if mean == 0.0:
        return _together("the sensitivities of the positions cancel")
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return record.DirectionEffects(
        separated=True,
        group=(),
        reason=f"{len(both)} ways of loading in both directions",
        crosstalk_v_per_n=Quantity(float(found[k + 1]), float(std[k + 1]), float(free)),
        half_asymmetry=Quantity(float(found[k]) / mean, float(std[k]) / abs(mean), float(free)),
    )


def _together(reason: str) -> record.DirectionEffects:
    return record.DirectionEffects(separated=False, group=_BOTH, reason=reason)


def _same(one: float, two: float, largest: float) -> bool:
    return abs(one - two) <= _SAME_LEVER * largest


def _distinct(levers: Sequence[float]) -> list[float]:
    kept: list[float] = []
    for lever in levers:
        if not any(_same(lever, other, max(levers)) for other in kept):
            kept.append(lever)
    return kept


def direction_entries(
    readings: Sequence[TakenReading],
    lines: tuple[record.ExperimentLine, ...],
    bench: ProfileData | None,
) -> list[DirectionEntry]:
    """Return the sensitivity of each experiment and how its torque was applied."""
    first = {taken.reading.experiment: taken for taken in reversed(readings)}
    out = []
    for number, line in zip(position_numbers(lines), lines, strict=True):
        detail = first[line.id].detail
        loading = detail.loading or (None if bench is None else bench.arm.loading) or "single"
        length = detail.arm_length_m or (None if bench is None else bench.arm.length_m)
        lever = 0.0 if loading == "couple" else 1.0 / (length or 1.0)
        out.append(DirectionEntry(number, line.direction, 1.0 / line.gain_nm_per_v, lever))
    return out


def side_force(
    largest: AppliedTorque | None, direction: record.PairedDifference | None, arm: Arm | None
) -> record.SideForce | None:
    """Return side force, bending moment and what they may do to the gain.

    Notes
    -----
    A weight pulls down in both directions while the torque changes sign: a crosstalk of c V/N
    makes sensitivities ``S + c/L`` and ``S - c/L``. It cancels in the mean of both directions; half
    their difference is the most that it may be, a true asymmetry of the sensor being the rest.
    """
    if largest is None or arm is None or not largest.torque_nm > 0.0:
        return None
    couple = arm.loading == "couple"
    force = 0.0 if couple else largest.torque_nm / largest.length_m
    distance = arm.side_force_distance_m
    if couple:
        reason = "a couple has no side force"
    elif direction is None:
        reason = (
            "one direction only: its crosstalk stands in the gain, with a size that is not known"
        )
    else:
        reason = "its crosstalk changes sign with the direction and cancels in the mean of both"
    return record.SideForce(
        force_n=force,
        bending_nm=None if distance is None else force * distance,
        half_direction_difference=None
        if direction is None
        else abs(direction.relative.value) / 2.0,
        cancels=couple or direction is not None,
        reason=reason,
    )
