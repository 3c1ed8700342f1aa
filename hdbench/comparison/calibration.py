"""Two calibrations: whether the gain has moved more than its uncertainty."""

from __future__ import annotations

import math
from dataclasses import replace
from operator import attrgetter

import numpy as np

from hdbench.calibration.lines import position_number
from hdbench.comparison.dynamic import Moved
from hdbench.comparison.score import Compared, SharedPart, Terms, compared
from hdbench.estimation.harmonics import combine
from hdbench.records import Quantity
from hdbench.results import CalibrationResult
from hdbench.results.calibration import BudgetRow

_GAIN = ("gain_nm_per_v", "torque gain", "N m/V")
# from three positions on their scatter has two degrees of freedom; one alone has k = 12.7
_FEWEST_PAIRS = 3


def compare_calibrations(a: CalibrationResult, b: CalibrationResult, terms: Terms) -> Moved:
    """Compare the gains of two calibrations, and say what was taken as common to both.

    Notes
    -----
    Where both have the same three positions or more, the verdict rests on the differences position
    by position: what a position does to the gain in both calibrations alike cancels, and what it
    does anew shows in their scatter. Positions, not experiments, count as independent.
    """
    first, second = a.gain_nm_per_v, b.gain_nm_per_v
    shared = [] if terms.independent else _shared_rows(a, b)
    parts = [SharedPart(first.value * rel, second.value * rel, dof) for _, rel, dof in shared]
    pairs = _paired(a, b, parts, terms.confidence)
    plain = compared(
        _GAIN,
        first,
        second,
        common=parts,
        confidence=terms.confidence,
        decides=pairs is None,
        note="means of all positions",
    )
    found = [plain] if pairs is None else [plain, pairs]
    for key, label, numbers in (
        ("consistency", "consistency", (a.consistency, b.consistency)),
        ("n_experiments", "experiments", (float(a.n_experiments), float(b.n_experiments))),
    ):
        if numbers != (None, None):
            found.append(Compared(key, label, "", *numbers, note="no uncertainty declared"))
    words = _assumption(shared, terms.independent, pairs is not None)
    return Moved(tuple(found), words)


def _budget(result: CalibrationResult) -> dict[str, BudgetRow]:
    """Return the rows of standards in the budget, by name."""
    return {row.name: row for row in result.budget if row.group != "gain" and row.declared}


def _shared_rows(
    a: CalibrationResult, b: CalibrationResult
) -> list[tuple[str, float, float | None]]:
    """Return what both budgets declare alike: name, relative standard uncertainty, dof."""
    second, shared = _budget(b), []
    declared = attrgetter("origin", "half_width", "distribution")
    for name, row in _budget(a).items():
        other = second.get(name)
        if other is not None and declared(row) == declared(other):
            shared.append((name, min(row.relative_std, other.relative_std), row.dof))
    return shared


def _position_gains(
    result: CalibrationResult, places: list[float]
) -> dict[tuple[int, str, str], float]:
    """Return the mean gain of every position, direction and range; new positions join `places`."""
    groups: dict[tuple[int, str, str], list[float]] = {}
    for line in result.experiments:
        key = (position_number(line.position_rad, places), line.direction, line.range)
        groups.setdefault(key, []).append(line.gain_nm_per_v)
    return {key: float(np.mean(gains)) for key, gains in groups.items()}


def _paired(
    a: CalibrationResult, b: CalibrationResult, parts: list[SharedPart], confidence: float
) -> Compared | None:
    """Return the mean difference by position; None below three positions or without scatter."""
    places: list[float] = []
    gains_a, gains_b = _position_gains(a, places), _position_gains(b, places)
    by_position: dict[int, list[tuple[float, float]]] = {}
    for key, gain in gains_a.items():
        if key in gains_b:
            by_position.setdefault(key[0], []).append((gain, gains_b[key]))
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
    own = [_standards(a, [p.in_a for p in parts]), _standards(b, [p.in_b for p in parts])]
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


def _standards(result: CalibrationResult, common: list[float]) -> float:
    """Return what standards of one side alone add, N m/V."""
    gain = result.gain_nm_per_v.value
    total = math.fsum((gain * row.relative_std) ** 2 for row in _budget(result).values())
    return math.sqrt(max(0.0, total - math.fsum(part**2 for part in common)))


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
