"""Held-out readings: each part of a calibration predicted from the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdbench.diagnosis.discovery.heldout import Prediction, gain_between
from hdbench.diagnosis.evidence import RANK, scaled
from hdbench.diagnosis.loads.fit import LoadFit, design
from hdbench.diagnosis.loads.table import IntArray, LoadTable, levels, one_hot
from hdbench.records.trace import FloatArray
from hdbench.results.diagnosis import Gain


def _fold_kinds(table: LoadTable) -> list[tuple[str, IntArray]]:
    """Return the ways to leave readings out that this table allows, the best one first."""
    level = levels(table)
    kinds = [("experiment", table.experiment)] if len(table.names) > 2 else []
    if level.max() > 2 and len(level) > level.max() + 1:
        kinds.append(("load level", level))
    return [*kinds, ("reading", np.arange(len(table), dtype=np.int64))]


def held_out(baseline: LoadFit, fit: LoadFit) -> tuple[str, float | None, float | None]:
    """Return what was left out together, and the RMS of baseline and final model on it, N m."""
    kinds = _fold_kinds(fit.table)
    for name, folds in kinds:
        before, after = _predicted_nm(baseline, folds), _predicted_nm(fit, folds)
        if before is not None and after is not None:
            return name, rms(before), rms(after)
    return kinds[-1][0], None, None


def gain_of(fit: LoadFit, places: Sequence[int], rng: np.random.Generator) -> Gain:
    """Return the held-out gain of a cause by the best way of leaving out that it allows."""
    table, used = fit.table, fit.table.used
    effect = np.sum([fit.effect_nm(place) for place in places], axis=0)
    seen = fit.refit(fit.others(places)).space().seen(effect) ** 2
    for _, folds in _fold_kinds(table):
        parts = np.bincount(folds[used], weights=seen)
        # a fold with more of an effect's sum of squares than this is not predicted by the others
        if parts.max() > 0.5 * parts.sum():
            continue
        before, after = _predicted_nm(fit, folds, places), _predicted_nm(fit, folds)
        if before is not None and after is not None:
            # fewer units than this cannot carry a bootstrap: readings are drawn instead
            many = len(np.unique(table.experiment[used])) >= 5
            units = one_hot(table.experiment[used] if many else np.arange(len(before))).T
            old, new = (Prediction(units @ x**2, units.sum(axis=1), 0.0) for x in (before, after))
            return gain_between(old, new, rng)
    return Gain(fit.noise_nm, fit.noise_nm, 0.0, (0.0, 0.0))


def _predicted_nm(fit: LoadFit, folds: IntArray, places: Sequence[int] = ()) -> FloatArray | None:
    """Return measured less predicted of each fold from all others, N m, terms `places` left out.

    None where the rest does not fix what a fold needs. Of an experiment that is left out as a whole
    the zero is the mean of its residuals, and what stays is scaled to the variance of a prediction
    with a known zero.
    """
    table, used = fit.table, fit.table.used
    response, numbers = table.reading_v[used], folds[used]
    columns = np.hstack(design(fit.base, fit.others(places), table))[used]
    of_zeros = np.s_[1 : 1 + len(table.names)]
    zeros = columns[:, of_zeros]
    columns = scaled(columns)[0]
    columns[:, of_zeros] = zeros
    left = np.full(len(response), np.nan)
    for number in np.unique(numbers):
        test = numbers == number
        u, s, v = np.linalg.svd(columns[~test], full_matrices=False)
        kept = s > RANK * s[0]
        u, s, v = u[:, kept], s[kept], v[kept]
        # a zero that no training reading shows is allowed to be unknown, nothing else is
        asked = columns[test]
        asked[:, of_zeros] = 0.0
        unknown = np.linalg.norm(asked - asked @ v.T @ v, axis=1)
        # a reading that is alone in fixing a coefficient says nothing about the prediction
        if float(unknown.max(initial=0.0)) > 3e-5:
            return None
        left[test] = response[test] - columns[test] @ (v.T @ (u.T @ response[~test] / s))
        for column in np.flatnonzero(~zeros[~test].any(axis=0)):
            mine = np.flatnonzero(test & (zeros[:, column] > 0.0))
            if len(mine) > 1:
                spread = left[mine] - left[mine].mean()
                left[mine] = spread * np.sqrt(len(mine) / (len(mine) - 1.0))
    return left / fit.slope_v_per_nm


def rms(values: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))
