"""What a cause is worth on readings: share, held-out gain, residual."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.confirm.gain import Gain
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads
from hdbench.diagnosis.loads.heldout import (
    Folds,
    fold_kinds,
    gain_between_readings,
    held_out_nm,
)
from hdbench.diagnosis.loads.names import space_of
from hdbench.diagnosis.loads.shapes import columns_of
from hdbench.records.trace import FloatArray

__all__ = ["Weighing"]

# a fold with more of an effect's sum of squares than this is not predicted by the others
_MOST_IN_ONE = 0.5


@dataclass(frozen=True, slots=True)
class Weighing:
    """What causes are weighed by.

    Parameters
    ----------
    fit : LoadFit
        Final fit.
    base : ndarray, shape (n, p)
        Columns of its baseline.
    baseline : LoadFit
        Fit of one gain, the zeros and the given model's causes.
    rng : Generator
        For the bootstrap.
    """

    fit: LoadFit
    base: FloatArray
    baseline: LoadFit
    rng: np.random.Generator

    @property
    def plain(self) -> FloatArray:
        """Columns of one gain and the zeros."""
        return self.base[:, : 1 + len(self.fit.table.names)]

    @property
    def noise_nm(self) -> float:
        """Standard deviation of a reading about the final fit, N m."""
        fit = self.fit
        return float(np.sqrt(fit.rss / max(fit.dof, 1))) / abs(fit.slope_v_per_nm)

    @property
    def variance_nm2(self) -> float:
        """Mean squared residual of the baseline, (N m)^2, above 0."""
        n = float(self.fit.table.used.sum())
        square = self.baseline.rss / n / self.baseline.slope_v_per_nm**2
        return max(square, float(np.finfo(float).tiny))

    def folds(self) -> Folds:
        """Return the best way to leave out readings that baseline and final model can predict."""
        kinds = fold_kinds(self.fit.table)
        for folds in kinds:
            before = held_out_nm(self.baseline, self.plain, folds)
            if before is not None and held_out_nm(self.fit, self.base, folds) is not None:
                return folds
        return kinds[-1]

    def rms_nm(self, folds: Folds) -> tuple[float | None, float | None]:
        """Return the RMS of baseline and final model on readings left out, N m."""
        both = (
            held_out_nm(self.baseline, self.plain, folds),
            held_out_nm(self.fit, self.base, folds),
        )
        before, after = (None if x is None else float(np.sqrt(np.mean(x**2))) for x in both)
        return before, after

    def share(self, places: tuple[int, ...]) -> float:
        """Return the share of variance of a cause's terms, added first to last or lost alone."""
        terms, first = self.fit.terms, places[0]
        rest = _without_all(terms, places)
        mine = tuple(terms[place] for place in places)
        added = self._rss(terms[:first]) - self._rss((*terms[:first], *mine))
        lost = self._rss(rest) - self._rss(terms)
        return self.share_of(max(added, lost))

    def share_of(self, drop: float) -> float:
        """Return a fall of the sum of squares, V^2, as a share of the baseline's."""
        return float(np.clip(drop / max(self.baseline.rss, 1e-300), 0.0, 1.0))

    def _rss(self, terms: tuple[Term, ...]) -> float:
        return fit_loads(self.fit.table, self.base, terms, refine=False).rss

    def gain(self, places: tuple[int, ...]) -> Gain:
        """Return the held-out gain of a cause by the best way of leaving out that it allows."""
        fit, table = self.fit, self.fit.table
        less = fit_loads(table, self.base, _without_all(fit.terms, places), refine=False)
        space = space_of(less)
        parts = [columns_of(fit.terms[i], table)[table.used] @ fit.linear[i] for i in places]
        effect = np.sum(parts, axis=0)
        seen = (space.basis @ (space.basis.T @ effect)) ** 2
        for folds in fold_kinds(table):
            if _in_one_fold(seen, folds.numbers[table.used]):
                continue
            after = held_out_nm(fit, self.base, folds)
            before = held_out_nm(fit, self.base, folds, places)
            if after is not None and before is not None:
                units = table.experiment[table.used]
                return gain_between_readings(before, after, units, self.rng)
        return Gain(self.noise_nm, self.noise_nm, 0.0, (0.0, 0.0))


def _without_all(terms: tuple[Term, ...], places: tuple[int, ...]) -> tuple[Term, ...]:
    return tuple(term for place, term in enumerate(terms) if place not in places)


def _in_one_fold(seen: FloatArray, folds: NDArray[np.int64]) -> bool:
    """Return whether one fold holds most of what shows of an effect: no other could predict it."""
    parts = np.bincount(folds, weights=seen)
    return bool(parts.max() > _MOST_IN_ONE * parts.sum())
