"""Gains that differ from clamping to clamping: chance, or a cause with a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads
from hdbench.diagnosis.loads.shapes import columns_of
from hdbench.diagnosis.loads.space import make_space
from hdbench.diagnosis.loads.table import LoadTable, base_columns
from hdbench.records.trace import FloatArray

__all__ = ["GainScatter", "find_scatter"]

# a Bayes factor of 20: by this much chance has to win over a name, or the name over chance
_WITHOUT_FORM_NATS = 3.0
_LEAST_DOF = 3
# one percent to either side: gains that the profile's consistency makes as good as never
_TAIL = 0.01

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class GainScatter:
    """Gains that differ between groups of readings without a form.

    Parameters
    ----------
    between : str
        ``positions``, ``clampings`` or ``experiments``.
    groups : ndarray of int, shape (n_readings,)
        Group of each reading.
    deviation : ndarray, shape (n_groups,)
        Relative deviation of each group's sensitivity from their mean.
    expected : float
        Relative standard deviation that the profile states.
    false_alarm : float
        Probability of deviations this large or larger if the profile is right.
    """

    between: str
    groups: IntArray
    deviation: FloatArray
    expected: float
    false_alarm: float

    @property
    def relative_std(self) -> float:
        """Standard deviation of the relative deviations, ddof 1."""
        return float(np.std(self.deviation, ddof=1))

    @property
    def within_profile(self) -> bool:
        """Whether the profile's consistency makes deviations as large."""
        return self.false_alarm >= _TAIL

    def to_dict(self) -> dict[str, object]:
        """Return it as the settings of a diagnosis hold it."""
        return {
            "between": self.between,
            "groups": len(self.deviation),
            "relative_std": self.relative_std,
            "profile_relative_std": self.expected,
            "within_profile": self.within_profile,
        }


def _inside(term: Term, table: LoadTable, groups: IntArray) -> bool:
    """Return whether a gain per group leaves nothing of a term."""
    free = base_columns(table, groups)
    space = make_space(free, table.reading_v, table.used)
    return not space.directions(columns_of(term, table)).size


def _lead_nats(fit: LoadFit, plain: LoadFit, free: LoadFit) -> float:
    """Return by how much gains that scatter about a common one explain more than names, nats.

    Of the k gains that `free` has more than `plain`, those that the names of `fit` do not explain
    cost what a normal prior of the best width takes from their likelihood: with q = 2 (log
    likelihood of `free` less that of `plain`) / k, (1 + ln q) / 2 each. Those that names explain
    cost as much under either account.
    """
    n = float(free.table.used.sum())
    count = plain.dof - free.dof
    width = max(n * float(np.log(plain.rss / free.rss)) / count, 1.0) if count > 0 else 1.0
    more = max(fit.dof - free.dof, 0)
    return 0.5 * n * float(np.log(fit.rss / free.rss)) - 0.5 * more * (1.0 + float(np.log(width)))


def _groupings(table: LoadTable) -> list[tuple[str, IntArray]]:
    """Return the ways in which gains may differ, the coarsest first."""
    kinds = [("positions", table.place), ("clampings", table.cell)]
    kinds.append(("experiments", table.experiment))
    seen: list[tuple[str, IntArray]] = []
    for name, groups in kinds:
        count = len(np.unique(groups))
        if count > 1 and all(count > len(np.unique(other)) for _, other in seen):
            seen.append((name, groups))
    return seen


def _deviations(table: LoadTable, terms: Sequence[Term], groups: IntArray) -> FloatArray:
    fit = fit_loads(table, base_columns(table, groups), terms, refine=False)
    count = len(np.unique(groups))
    slopes = fit.base[0] + np.concatenate(([0.0], fit.base[-(count - 1) :]))
    return np.asarray(slopes / slopes.mean() - 1.0)


def _tails(deviation: FloatArray, place: IntArray, expected: float) -> tuple[float, float]:
    """Return the chance of deviations as large, and of as small, as the profile states.

    Groups at one position share what the position does to the gain: the means of positions are held
    against the profile's consistency, and so is what is left inside positions; the less likely of
    the two counts, twice.
    """
    from scipy.special import gammainc, gammaincc

    if not expected > 0.0:
        return 0.0, 0.0
    _, at = np.unique(place, return_inverse=True)
    means = np.bincount(at, weights=deviation) / np.bincount(at)
    parts = [(means - means.mean(), len(means) - 1)]
    parts.append((deviation - means[at], len(deviation) - len(means)))
    held = [(0.5 * dof, 0.5 * float(left @ left) / expected**2) for left, dof in parts if dof > 0]
    above = min(1.0, len(held) * min(float(gammaincc(half, ratio)) for half, ratio in held))
    return above, float(gammainc(*held[0]))


def find_scatter(
    fit: LoadFit, n_known: int, expected: float, present: GainScatter | None = None
) -> tuple[GainScatter, tuple[Term, ...]] | None:
    """Return gains that differ without a form, where that explains more than names do.

    Parameters
    ----------
    fit : LoadFit
        Fit with all causes that were accepted.
    n_known : int
        Terms that come first and stay.
    expected : float
        Relative standard deviation of gains that the profile states.
    present : GainScatter or None
        Scatter that the fit holds already: only a finer one is looked for.

    Returns
    -------
    scatter : GainScatter
    terms : tuple of Term
        Terms of `fit` that stay beside it.

    Notes
    -----
    Gains that scatter between positions (clampings, experiments) are held against the accepted
    names by their marginal likelihood, and have to win by 3 nats. Where the
    accepted names take up every difference between positions, nothing in the readings tells a
    harmonic of the position from chance: differences no smaller than the profile's consistency are
    then taken for what the profile says they are.
    """
    table = fit.table
    best: tuple[float, GainScatter, tuple[Term, ...]] | None = None
    for name, groups in _groupings(table):
        if present is not None and len(np.unique(groups)) <= len(present.deviation):
            continue
        kept = tuple(
            term
            for place, term in enumerate(fit.terms)
            if place < n_known or not _inside(term, table, groups)
        )
        trial = fit_loads(table, base_columns(table, groups), kept)
        plain = fit_loads(table, base_columns(table), kept)
        # with fewer degrees of freedom than gains that were freed there is no noise to compare with
        if trial.dof < max(_LEAST_DOF, plain.dof - trial.dof):
            continue
        named = len(kept) < len(fit.terms)
        # one experiment per position repeats nothing: there a form has to win
        alone = named and len(table.names) == len(np.unique(table.place))
        lead = -_WITHOUT_FORM_NATS if alone else _WITHOUT_FORM_NATS
        gain = _lead_nats(fit, plain, trial) - lead
        deviation = _deviations(table, kept, groups)
        above, below = _tails(
            deviation, table.place[np.unique(groups, return_index=True)[1]], expected
        )
        saturated = named and trial.dof >= fit.dof and below > _TAIL and name == "positions"
        if not (gain > 0.0 or saturated):
            continue
        score = max(gain, 0.0)
        if best is None or score > best[0]:
            best = (score, GainScatter(name, groups, deviation, expected, above), kept)
    return None if best is None else (best[1], best[2])
