"""Gains that differ from clamping to clamping: chance, or a cause with a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.evidence import RIVAL_NATS, orthonormal, share_p_value
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads
from hdbench.diagnosis.loads.forms import Form, Term
from hdbench.diagnosis.loads.search import Accepted
from hdbench.diagnosis.loads.table import LoadTable, base_columns, groupings, one_hot
from hdbench.records.trace import FloatArray

__all__ = ["GainScatter", "find_scatter", "name_between"]

# degrees of freedom that noise, or a scatter, needs before anything is held against it
_LEAST_DOF = 3
# one percent to either side: gains that the profile's consistency makes as good as never
_TAIL = 0.01
_ROUNDING = 1e-9

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class GainScatter:
    """Gains that differ between groups of readings without a form."""

    between: str  # positions, clampings or experiments
    groups: IntArray  # of each reading
    deviation: FloatArray  # relative, of each group from their mean
    expected: float  # relative standard deviation that the profile states
    false_alarm: float  # of deviations as large where the profile is right

    @property
    def relative_std(self) -> float:
        """Standard deviation of the relative deviations."""
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


def _only_gains(term: Term, table: LoadTable, base: FloatArray) -> bool:
    """Return whether gains of groups and zeros leave nothing of a term."""
    columns = term.columns(table)[table.used]
    basis = orthonormal(base[table.used])
    left = columns - basis @ (basis.T @ columns)
    return bool(np.abs(left).max() <= np.sqrt(_ROUNDING) * np.abs(columns).max())


def _lead_nats(fit: LoadFit, plain: LoadFit, free: LoadFit) -> float:
    """Return by how much gains that scatter about a common one explain more than names, nats.

    Of the k gains that `free` has more than `plain`, those that the names of `fit` do not explain
    cost what a normal prior of the best width takes from their likelihood: with q = 2 (log
    likelihood of `free` less that of `plain`) / k, (1 + ln q) / 2 each.
    """
    n = float(free.table.used.sum())
    count = max(plain.dof - free.dof, 1)
    width = max(n * float(np.log(plain.rss / free.rss)) / count, 1.0)
    more = max(fit.dof - free.dof, 0)
    return 0.5 * n * float(np.log(fit.rss / free.rss)) - 0.5 * more * (1.0 + float(np.log(width)))


def _tails(deviation: FloatArray, place: IntArray, expected: float) -> tuple[float, float]:
    """Return the chance of deviations as large, and of as small, as the profile states.

    Groups at one position share what the position does to the gain: the means of positions, and
    what is left inside positions, are held against the consistency; the less likely counts, twice.
    """
    from scipy.special import gammainc, gammaincc

    if not expected > 0.0:
        return 0.0, 0.0
    at = np.unique(place, return_inverse=True)[1]
    means = np.bincount(at, weights=deviation) / np.bincount(at)
    parts = [(means - means.mean(), len(means) - 1)]
    parts.append((deviation - means[at], len(deviation) - len(means)))
    held = [(0.5 * dof, 0.5 * float(left @ left) / expected**2) for left, dof in parts if dof > 0]
    above = min(1.0, len(held) * min(float(gammaincc(*one)) for one in held))
    return above, float(gammainc(*held[0]))


def find_scatter(fit: LoadFit, known: int, expected: float) -> tuple[GainScatter, LoadFit] | None:
    """Return gains that differ without a form where that explains more than names do.

    Scatter has to win by 3 nats. Where each position has one experiment nothing repeats: there a
    name has to win. Names that use up every difference between positions are told from chance only
    where the profile's consistency makes differences as small as good as never.
    """
    table = fit.table
    best: tuple[float, GainScatter, LoadFit] | None = None
    for name, groups in groupings(table):
        base = base_columns(table, groups)
        kept = [t for i, t in enumerate(fit.terms) if i < known or not _only_gains(t, table, base)]
        free = fit_loads(table, base, kept)
        plain = fit_loads(table, base_columns(table), kept)
        # with fewer degrees of freedom than gains that were freed there is no noise to compare with
        if free.dof < max(_LEAST_DOF, plain.dof - free.dof):
            continue
        count = len(np.unique(groups))
        slopes = free.base[0] + np.concatenate(([0.0], free.base[1 - count :]))
        deviation = np.asarray(slopes / slopes.mean() - 1.0)
        place = table.place[np.unique(groups, return_index=True)[1]]
        above, below = _tails(deviation, place, expected)
        named = len(kept) < len(fit.terms)
        alone = named and len(table.names) == len(np.unique(table.place))
        lead = _lead_nats(fit, plain, free) + (RIVAL_NATS if alone else -RIVAL_NATS)
        used_up = named and free.dof >= fit.dof and below > _TAIL and name == "positions"
        if (lead > 0.0 or used_up) and (best is None or lead > best[0]):
            best = (lead, GainScatter(name, groups, deviation, expected, above), free)
    return None if best is None else best[1:]


def _pattern(form: Form, table: LoadTable, scatter: GainScatter) -> FloatArray | None:
    """Return the gain that a form adds to each group; None where it adds more than gains."""
    which = one_hot(scatter.groups)
    design = np.hstack([table.torque_nm[:, None] * which, one_hot(table.experiment)])
    if form.shape or not _only_gains(Term(form, {}), table, design):
        return None
    columns = Term(form, {}).columns(table)
    return np.asarray(np.linalg.lstsq(design, columns, rcond=_ROUNDING)[0][: which.shape[1]])


def name_between(
    fit: LoadFit, forms: Sequence[Form], scatter: GainScatter, alpha: float
) -> tuple[LoadFit, GainScatter, Accepted | None, FloatArray]:
    """Name a cause whose gains stand above the scatter of all others.

    What is the same for all readings at a position is held against the scatter of the positions'
    mean gains, everything else against the scatter inside positions: the two strata of a split-plot
    design (Searle, Casella, McCulloch, Variance Components, 1992, chapter 4).

    Returns
    -------
    fit, scatter, accepted, base
        With the cause, what stays of the scatter, and the baseline's columns of that fit.
    """
    table = fit.table
    base = base_columns(table, scatter.groups)
    place = table.place[np.unique(scatter.groups, return_index=True)[1]]
    mean = one_hot(place) / one_hot(place).sum(axis=0)
    tests = []
    for form in forms:
        pattern = _pattern(form, table, scatter)
        if pattern is None:
            continue
        same = pattern - (mean.T @ pattern)[np.unique(place, return_inverse=True)[1]]
        whole = float(np.abs(same).max()) < _ROUNDING
        null = np.ones((mean.shape[1], 1)) if whole else one_hot(place)
        design, values = (
            (mean.T @ pattern, mean.T @ scatter.deviation)
            if whole
            else (pattern, scatter.deviation)
        )
        basis = orthonormal(null)
        left, seen = (x - basis @ (basis.T @ x) for x in (values, design))
        along = orthonormal(seen)
        dof, rank = len(values) - basis.shape[1], along.shape[1]
        if rank == 0 or dof - rank < _LEAST_DOF - 1:
            continue
        share = float(np.sum((along.T @ left) ** 2) / np.sum(left**2))
        nats = -0.5 * dof * float(np.log1p(-share)) - 0.5 * rank * float(np.log(len(values)))
        variance = float(np.sum(left**2)) * (1.0 - share) / (dof - rank)
        std = np.linalg.pinv(seen.T @ seen) * variance
        tests.append((share_p_value(share, rank, dof), nats, form, pattern, std))
    best = min(tests, key=lambda test: test[0], default=None)
    if best is None or not (best[0] * len(tests) < alpha and best[1] > 0.0):
        return fit, scatter, None, base
    chance, nats, form, pattern, std = best
    alike = [f.name for _, _, f, p, _ in tests if _same_span(p, pattern) and f.name != form.name]
    fixed = orthonormal(np.hstack([np.ones((len(pattern), 1)), pattern]))
    free = np.linalg.svd(fixed)[0][:, fixed.shape[1] :]
    columns = table.torque_nm[:, None] * (one_hot(scatter.groups) @ free)
    base = np.hstack([base_columns(table), columns])
    scatter = replace(scatter, deviation=free @ (free.T @ scatter.deviation))
    fit = fit_loads(table, base, (*fit.terms, Term(form, {})))
    fit = replace(fit, covariances=(*fit.covariances[:-1], std))
    group = (form.name, *dict.fromkeys(alike))
    places = (len(fit.terms) - 1,)
    found = Accepted(places, min(1.0, chance * len(tests)), nats, group, (), 1.0)
    return fit, scatter, found, base


def _same_span(first: FloatArray, second: FloatArray) -> bool:
    ranks = [np.linalg.matrix_rank(x / np.abs(x).max(axis=0)) for x in (first, second)]
    both = np.hstack([first, second])
    return bool(ranks[0] == ranks[1] == np.linalg.matrix_rank(both / np.abs(both).max(axis=0)))
