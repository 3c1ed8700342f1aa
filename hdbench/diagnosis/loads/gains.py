"""Gains that differ from clamping to clamping: chance, or a cause with a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.evidence import (
    LEAST_DOF,
    RANK,
    RIVAL_NATS,
    SAME_SPACE,
    orthonormal,
    share_p_value,
    sine_squared,
)
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads
from hdbench.diagnosis.loads.forms import Form, Term
from hdbench.diagnosis.loads.search import Accepted
from hdbench.diagnosis.loads.table import IntArray, base_columns, groupings, one_hot
from hdbench.records.trace import FloatArray

# one percent to either side: gains that the profile's consistency makes as good as never
_TAIL = 0.01


@dataclass(frozen=True, slots=True)
class GainScatter:
    """Gains that differ between groups of readings without a form."""

    between: str  # positions, clampings or experiments
    groups: IntArray  # of each reading
    place: IntArray  # of each group
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


def _spans(base: FloatArray, columns: FloatArray) -> bool:
    """Return whether gains of groups and zeros leave nothing of a term's columns."""
    basis = orthonormal(base)
    left = columns - basis @ (basis.T @ columns)
    return bool(np.abs(left).max() <= np.sqrt(RANK) * np.abs(columns).max())


def _lead_nats(fit: LoadFit, plain: LoadFit, free: LoadFit) -> float:
    """Return by how much gains that scatter about a common one explain more than names, nats."""
    # with q = 2 (log likelihood of `free` less that of `plain`) / k, a normal prior of the best
    # width takes (1 + ln q) / 2 for each of the k gains that the names do not explain
    n = float(free.table.used.sum())
    count = max(plain.dof - free.dof, 1)
    width = max(n * float(np.log(plain.rss / free.rss)) / count, 1.0)
    more = max(fit.dof - free.dof, 0)
    return 0.5 * n * float(np.log(fit.rss / free.rss)) - 0.5 * more * (1.0 + float(np.log(width)))


def _tails(deviation: FloatArray, place: IntArray, expected: float) -> tuple[float, float]:
    """Return the chance of deviations as large, and of as small, as the profile states."""
    from scipy.special import gammainc, gammaincc

    if not expected > 0.0:
        return 0.0, 0.0
    # groups at one position share what it does to the gain: means of positions, and what is left
    # inside them, are held against the consistency; the less likely counts, twice
    at = np.unique(place, return_inverse=True)[1]
    means = np.bincount(at, weights=deviation) / np.bincount(at)
    parts = [(means - means.mean(), len(means) - 1)]
    parts.append((deviation - means[at], len(deviation) - len(means)))
    held = [(0.5 * dof, 0.5 * float(left @ left) / expected**2) for left, dof in parts if dof > 0]
    above = min(1.0, len(held) * min(float(gammaincc(*one)) for one in held))
    return above, float(gammainc(*held[0]))


def find_scatter(fit: LoadFit, expected: float) -> GainScatter | None:
    """Return gains that differ without a form where that explains 3 nats more than names do."""
    table, used = fit.table, fit.table.used
    plain_base = base_columns(table)
    best, scatter = -np.inf, None
    for name, groups in groupings(table):
        base = base_columns(table, groups)
        kept = [
            term
            for term in fit.terms
            if term.known or not _spans(base[used], term.columns(table)[used])
        ]
        free, plain = fit_loads(table, base, kept), fit_loads(table, plain_base, kept)
        # with fewer degrees of freedom than gains that were freed there is no noise to compare with
        if free.dof < max(LEAST_DOF, plain.dof - free.dof):
            continue
        _, first = np.unique(groups, return_index=True)
        more = free.baseline_v[plain_base.shape[1] :]
        slopes = free.baseline_v[0] + np.concatenate(([0.0], more))
        deviation = np.asarray(slopes / slopes.mean() - 1.0)
        above, below = _tails(deviation, table.place[first], expected)
        named = len(kept) < len(fit.terms)
        # where each position has one experiment nothing repeats: there a name has to win
        alone = named and len(table.names) == len(np.unique(table.place))
        lead = _lead_nats(fit, plain, free) + (RIVAL_NATS if alone else -RIVAL_NATS)
        # names that use up every difference are chance only where the profile excludes so little
        used_up = named and free.dof >= fit.dof and below > _TAIL and name == "positions"
        if (lead > 0.0 or used_up) and lead > best:
            best = lead
            scatter = GainScatter(name, groups, table.place[first], deviation, expected, above)
    return scatter


@dataclass(frozen=True, slots=True)
class _Test:
    """A form whose gains are held against the scatter of all others."""

    form: Form
    pattern: FloatArray  # gain that it adds to each group
    p_value: float
    nats: float
    covariance: FloatArray


def _tested(form: Form, fit: LoadFit, scatter: GainScatter) -> _Test | None:
    """Return the test of a form; None where it adds more than gains, or nothing can be told."""
    table, which = fit.table, one_hot(scatter.groups)
    gains = np.hstack([table.torque_nm[:, None] * which, one_hot(table.experiment)])
    if form.shape:
        return None
    columns = Term(form, {}).columns(table)
    if not _spans(gains[table.used], columns[table.used]):
        return None
    gain = np.linalg.lstsq(gains, columns, rcond=RANK)[0]
    pattern = np.asarray(gain[: which.shape[1]], dtype=np.float64)
    design, values = pattern, scatter.deviation
    # what is the same for all readings at a position is held against the scatter of the positions,
    # all else against that inside them: the two strata of a split-plot design (Searle, Casella,
    # McCulloch, Variance Components, 1992, chapter 4)
    place = one_hot(scatter.place)
    mean = place / place.sum(axis=0)
    if float(np.abs(pattern - place @ (mean.T @ pattern)).max()) < RANK:
        design, values = mean.T @ pattern, mean.T @ values
        place = np.ones((len(values), 1))
    basis = orthonormal(place)
    left, seen = (x - basis @ (basis.T @ x) for x in (values, design))
    along = orthonormal(seen)
    dof, rank = len(values) - basis.shape[1], along.shape[1]
    if rank == 0 or dof - rank < LEAST_DOF - 1:
        return None
    rss = float(np.sum(left**2))
    share = float(np.sum((along.T @ left) ** 2)) / rss
    nats = -0.5 * dof * float(np.log1p(-share)) - 0.5 * rank * float(np.log(len(values)))
    covariance = np.linalg.pinv(seen.T @ seen) * rss * (1.0 - share) / (dof - rank)
    return _Test(form, pattern, float(share_p_value(share, rank, dof)), nats, covariance)


def name_between(
    fit: LoadFit, forms: Sequence[Form], scatter: GainScatter, alpha: float
) -> tuple[LoadFit, GainScatter, tuple[Accepted, ...]]:
    """Name a cause whose gains stand above the scatter of all others: fit, scatter and cause."""
    tests = [test for form in forms if (test := _tested(form, fit, scatter)) is not None]
    best = min(tests, key=lambda test: test.p_value, default=None)
    if best is None or not (best.p_value * len(tests) < alpha and best.nats > 0.0):
        return fit, scatter, ()
    pattern, name = best.pattern, best.form.name
    span = orthonormal(pattern)
    alike = [
        test.form.name
        for test in tests
        if sine_squared(orthonormal(test.pattern), span) < SAME_SPACE
    ]
    fixed = orthonormal(np.hstack([np.ones((len(pattern), 1)), pattern]))
    free = np.linalg.svd(fixed)[0][:, fixed.shape[1] :]
    table = fit.table
    columns = table.torque_nm[:, None] * (one_hot(scatter.groups) @ free)
    base = np.hstack([base_columns(table), columns])
    scatter = replace(scatter, deviation=free @ (free.T @ scatter.deviation))
    fit = fit_loads(table, base, (*fit.terms, Term(best.form, {})))
    fit = replace(fit, covariances=(*fit.covariances[:-1], best.covariance))
    chance = min(1.0, best.p_value * len(tests))
    group = tuple(dict.fromkeys((name, *alike)))
    found = Accepted((len(fit.terms) - 1,), chance, best.nats, group, probability=1.0)
    return fit, scatter, (found,)
