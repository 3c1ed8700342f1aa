"""Values that stand off the others: flagged, never removed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Outlier:
    """One value that stands off.

    Parameters
    ----------
    index : int
        Its place.
    statistic, limit : float
        Distance from the mean over the standard deviation, without the values that stand further
        off; what chance allows.
    """

    index: int
    statistic: float
    limit: float


def grubbs_limit(n: int) -> float:
    """Return the largest distance from the mean over s that chance allows in n normal values.

    Notes
    -----
    ``(n - 1)/sqrt(n) sqrt(t^2 / (n - 2 + t^2))`` with t the quantile at ``1 - 0.05 / (2 n)``
    of n - 2 degrees of freedom.

    References
    ----------
    .. [1] F. E. Grubbs, Technometrics 11 (1969) 1, doi:10.1080/00401706.1969.10490657.
    """
    from scipy.special import stdtrit

    t = float(stdtrit(n - 2, 1.0 - 0.05 / (2.0 * n)))
    return float((n - 1) / np.sqrt(n) * np.sqrt(t**2 / (n - 2 + t**2)))


def extreme_values(values: Sequence[float]) -> tuple[Outlier, ...]:
    """Find values that stand off the others, several that hide each other among them.

    Notes
    -----
    The value furthest from the mean is taken out, the next sought among the rest, and so on; as
    many are named as the *last* step that was beyond its limit: two large ones that widen s and
    hide each other are then found. For one value this is Grubbs' test.

    References
    ----------
    .. [1] B. Rosner, Technometrics 25 (1983) 165, doi:10.1080/00401706.1983.10487848.
    """
    left = list(enumerate(float(v) for v in values))
    limit = min(10, len(left) // 3)
    seen: list[Outlier] = []
    count = 0
    scale = max((abs(v) for _, v in left), default=0.0)
    while len(seen) < limit and len(left) >= 3:
        numbers = np.array([v for _, v in left])
        std = float(numbers.std(ddof=1))
        # a spread at rounding level says nothing about a value
        if not std > 1e-12 * scale:
            break
        far = int(np.argmax(np.abs(numbers - numbers.mean())))
        statistic = float(abs(numbers[far] - numbers.mean())) / std
        found = Outlier(left[far][0], statistic, grubbs_limit(len(left)))
        seen.append(found)
        if found.statistic > found.limit:
            count = len(seen)
        left.pop(far)
    return tuple(seen[:count])


@dataclass(frozen=True, slots=True)
class GainOutlier:
    """Gains that stand off.

    Parameters
    ----------
    kind : str
        ``gain``: one experiment among others at its position, or one of all where each position
        has one; ``position``: all experiments of a position.
    places : tuple of int
        Places of the experiments.
    statistic, limit : float
        Distance over the standard deviation; what chance allows.
    """

    kind: str
    places: tuple[int, ...]
    statistic: float
    limit: float


def gain_outliers(gains: Sequence[float], positions: Sequence[int]) -> tuple[GainOutlier, ...]:
    """Find gains that stand off the others.

    Notes
    -----
    Gains that share a position share its effect: they would hide or accuse each other in a test
    of all gains. The position means are searched, and the gains of a position with three or more
    about their own mean.
    """
    members: dict[int, list[int]] = {}
    for place, position in enumerate(positions):
        members.setdefault(position, []).append(place)
    groups = list(members.values())
    means = [float(np.mean([gains[k] for k in group])) for group in groups]
    found = [
        GainOutlier(
            "gain" if len(groups[o.index]) == 1 else "position",
            tuple(groups[o.index]),
            o.statistic,
            o.limit,
        )
        for o in extreme_values(means)
    ]
    for group in groups:
        found += [
            GainOutlier("gain", (group[o.index],), o.statistic, o.limit)
            for o in extreme_values([gains[k] for k in group])
        ]
    return tuple(found)
