"""Two calibrations: whether the gain has moved more than its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hdbench.errors import DataError
from hdbench.estimation.harmonics import combine
from hdbench.records import Quantity
from hdbench.regression.comparison.item import Compared
from hdbench.regression.comparison.score import Part, compared
from hdbench.regression.comparison.side import Side, number, quantity

__all__ = ["Gains", "compare_calibrations"]

_GAIN = ("gain_nm_per_v", "torque gain", "N m/V")
# from three positions on their scatter has two degrees of freedom; one alone has k = 12.7
_FEWEST_PAIRS = 3
# angles of one position, as in the evaluation: a sixth of a tooth of 200
_SAME_POSITION_RAD = 5e-3


@dataclass(frozen=True, slots=True)
class Gains:
    """What two calibrations say of the gain.

    Parameters
    ----------
    quantities : tuple of Compared
        Gain, gain pair by pair, consistency; the verdict rests on one of them.
    assumption : str
        What was taken as common to both.
    """

    quantities: tuple[Compared, ...]
    assumption: str


def compare_calibrations(
    a: Side, b: Side, *, confidence: float = 0.95, independent: bool = False
) -> Gains:
    """Compare the gains of two calibrations.

    Notes
    -----
    Where both have the same three positions or more, the verdict rests on the differences position
    by position: what a position does to the gain in both calibrations alike cancels, and what it
    does anew shows in their scatter. Positions, not experiments, count as independent.
    """
    first, second = (_gain(side) for side in (a, b))
    shared = [] if independent else _shared_rows(a, b)
    parts = [Part(first.value * rel, second.value * rel, dof) for _, rel, dof in shared]
    pairs = _paired(a, b, parts, first, second, confidence)
    plain = compared(
        _GAIN,
        first,
        second,
        common=parts,
        confidence=confidence,
        decides=pairs is None,
        note="means of all positions",
    )
    rest = (
        _number("consistency", "consistency", a, b),
        _number("n_experiments", "experiments", a, b),
    )
    found = tuple(x for x in (plain, pairs, *rest) if x is not None)
    return Gains(found, _assumption(shared, independent, pairs is not None))


def _gain(side: Side) -> Quantity:
    gain = quantity(side.result.get("gain_nm_per_v"), f"{side.where}: gain_nm_per_v")
    if gain is None or gain.value == 0.0:
        raise DataError(
            f"gain_nm_per_v is {side.result.get('gain_nm_per_v')!r:.40}; needed: a gain, N m/V",
            where=f"{side.where}: gain_nm_per_v",
            fix="evaluate the calibration again with --from",
        )
    return gain


def _number(key: str, label: str, a: Side, b: Side) -> Compared | None:
    values = number(a.result.get(key)), number(b.result.get(key))
    if values == (None, None):
        return None
    return Compared(key, label, "", *values, note="no uncertainty declared")


def _budget(side: Side) -> dict[str, Mapping[str, Any]]:
    """Return the rows of standards in the budget, by name."""
    rows = side.result.get("budget")
    return {
        str(row.get("name")): row
        for row in (rows if isinstance(rows, list) else ())
        if isinstance(row, Mapping) and row.get("group") != "gain" and row.get("declared") is True
    }


def _shared_rows(a: Side, b: Side) -> list[tuple[str, float, float | None]]:
    """Return what both budgets declare alike: name, relative standard uncertainty, dof."""
    first, second = _budget(a), _budget(b)
    shared = []
    for name, row in first.items():
        other = second.get(name)
        if other is None or any(
            row.get(key) != other.get(key) for key in ("origin", "half_width", "distribution")
        ):
            continue
        sizes = [number(r.get("relative_std")) for r in (row, other)]
        if None not in sizes:
            shared.append((name, min(s for s in sizes if s is not None), number(row.get("dof"))))
    return shared


def _place(position_rad: float, places: list[float]) -> int:
    """Return the number of a position; a full turn is the same position."""
    for place, known in enumerate(places):
        if abs(math.remainder(position_rad - known, 2.0 * math.pi)) < _SAME_POSITION_RAD:
            return place
    places.append(position_rad)
    return len(places) - 1


def _position_gains(side: Side, places: list[float]) -> dict[tuple[int, str, str], float]:
    """Return the mean gain of every position, direction and range; new positions join `places`."""
    groups: dict[tuple[int, str, str], list[float]] = {}
    for line in side.result.get("experiments", ()):
        gain, position = number(line.get("gain_nm_per_v")), number(line.get("position_rad"))
        if isinstance(line.get("gain_nm_per_v"), Mapping):
            gain = number(line["gain_nm_per_v"].get("value"))
        if gain is None or position is None:
            continue
        key = (_place(position, places), str(line.get("direction")), str(line.get("range")))
        groups.setdefault(key, []).append(gain)
    return {key: float(np.mean(gains)) for key, gains in groups.items()}


def _paired(
    a: Side, b: Side, parts: list[Part], first: Quantity, second: Quantity, confidence: float
) -> Compared | None:
    """Return the mean difference by position; None below three positions or without scatter."""
    places: list[float] = []
    gains_a, gains_b = _position_gains(a, places), _position_gains(b, places)
    by_position: dict[int, list[tuple[float, float]]] = {}
    for key in gains_a.keys() & gains_b.keys():
        by_position.setdefault(key[0], []).append((gains_a[key], gains_b[key]))
    if len(by_position) < _FEWEST_PAIRS:
        return None
    means = np.array([np.mean(pairs, axis=0) for pairs in by_position.values()])
    steps = means[:, 1] - means[:, 0]
    if not np.ptp(steps) > 0.0:
        # equal to the last digit: one result copied from the other, or computed; no scatter to use
        return None
    n = len(steps)
    scatter = Quantity(float(steps.mean()), float(steps.std(ddof=1)) / math.sqrt(n), n - 1.0)
    # what the standards add: each side's own ones in full, the shared ones as far as they differ
    own = [_standards(a, first, parts, 0), _standards(b, second, parts, 1)]
    whole = combine(
        (scatter.std, scatter.dof), (own[1], None), *((abs(p.in_b), p.dof) for p in parts)
    )
    found = compared(
        ("gain_paired_nm_per_v", f"torque gain, {n} positions pairwise", "N m/V"),
        Quantity(float(means[:, 0].mean()), math.hypot(own[0], *(p.in_a for p in parts))),
        Quantity(float(means[:, 1].mean()), *whole),
        common=parts,
        confidence=confidence,
        decides=True,
        note=f"scatter of {n} differences and what standards add; decides",
    )
    # the scatter belongs to the difference: neither mean by itself has this uncertainty
    return replace(found, a=float(means[:, 0].mean()), b=float(means[:, 1].mean()))


def _standards(side: Side, gain: Quantity, parts: list[Part], which: int) -> float:
    """Return what standards of one side alone add, N m/V."""
    rows = [number(row.get("relative_std")) for row in _budget(side).values()]
    total = math.fsum((gain.value * rel) ** 2 for rel in rows if rel is not None)
    common = math.fsum((part.in_b if which else part.in_a) ** 2 for part in parts)
    return math.sqrt(max(0.0, total - common))


def _assumption(
    shared: list[tuple[str, float, float | None]], independent: bool, paired: bool
) -> str:
    if independent:
        words = "standards taken as independent, as asked"
    elif shared:
        names = ", ".join(name for name, _, _ in shared)
        words = f"declared alike in both, so one error in both: {names}"
    else:
        words = "no standard is declared alike in both results: taken as independent"
    if paired:
        words += "; positions compared pairwise, each position one independent difference"
    return words
