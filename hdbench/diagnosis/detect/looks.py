"""All looks at one residual, each with its share of the false-alarm rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.detect.bank import Bank, Grams, bank_gram
from hdbench.diagnosis.detect.geometry import Geometry, geometry
from hdbench.diagnosis.detect.law import Law, local_p
from hdbench.diagnosis.detect.linelooks import SHARES, Look, line_looks
from hdbench.diagnosis.detect.scan import ScanResult
from hdbench.diagnosis.detect.survey import Survey
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.noise.whitened import Space, Whitener
from hdbench.records.trace import FloatArray

__all__ = ["SHARES", "Look", "Looks", "look_at", "look_at_families"]


def make_grams(survey: Survey, whitener: Whitener, last: Grams) -> Grams:
    """Return the Gram matrices for a noise; the last ones where the noise is the same."""
    if _same(last.whitener, whitener):
        scale = last.whitener.std / whitener.std
        return Grams(whitener, last.bank.scaled(scale), last.curves.scaled(scale))
    return Grams(whitener, bank_gram(survey.bank, whitener), bank_gram(survey.curves, whitener))


def _same(first: Whitener, second: Whitener) -> bool:
    """Return whether two whiteners are the same but for their scale."""
    return bool(
        np.array_equal(first.kernel, second.kernel) and np.array_equal(first.used, second.used)
    )


@dataclass(frozen=True, slots=True)
class Looks:
    """Every look at one residual.

    Parameters
    ----------
    looks : tuple of Look
        Scans, known places, families and curves.
    scans : mapping of str to ScanResult
        By domain.
    bank : Geometry
        How the families stand in the residual's space.
    whitener : Whitener
        Noise.
    """

    looks: tuple[Look, ...]
    scans: dict[str, ScanResult]
    bank: Geometry
    whitener: Whitener


def _bank_looks(
    bank: Bank, shape: Geometry, law: Law, space: Space, share: float, skip: set[str]
) -> list[Look]:
    """Return the best member of every family, whole where one of its harmonics is the best."""
    if not bank.members:
        return []
    numerators = bank.table.T @ space.pull.astype(np.float32)
    statistics = shape.statistics(bank, numerators.astype(np.float64)[:, None])[:, 0]
    dof = shape.dof()
    p = local_p(statistics, dof.astype(np.float64))
    looks = []
    for name, index in bank.families.items():
        alive = [k for k in index if dof[k] > 0]
        if not alive or name in skip or name not in law.families:
            continue
        best = min(alive, key=lambda k: (p[k], -statistics[k]))
        family = law.families[name]
        here = np.array([p[best]])
        chance = float(family.probability(here)[0]) * law.together / share
        term = bank.members[best].term
        wholes = [k for k in alive if bank.members[k].whole]
        own = next(k for k in wholes if bank.members[k].term is term)
        trials = _told_apart(statistics[wholes], float(statistics[own]))
        chance = float(np.clip(chance, 1e-300, 1.0))
        looks.append(Look(name, (term,), float(statistics[own]), trials, chance, int(dof[own])))
    return looks


def _told_apart(statistics: FloatArray, best: float) -> float:
    """Return how many members the residual tells from the best: one over their mean likelihood."""
    return 1.0 / float(np.mean(np.exp(np.minimum(0.5 * (statistics - best), 0.0))))


def look_at_families(space: Space, survey: Survey, last: Grams) -> tuple[tuple[Look, ...], Grams]:
    """Test every family.

    Parameters
    ----------
    space : Space
        Whitened residual.
    survey : Survey
        What was planned for its record.
    last : Grams
        Gram matrices of the look before.

    Returns
    -------
    looks : tuple of Look
    grams : Grams
        Gram matrices that belong to the noise.
    """
    grams = make_grams(survey, space.whitener, last)
    shape = geometry(survey.bank, grams.bank, space)
    looks = _bank_looks(survey.bank, shape, survey.law, space, SHARES["families"], set())
    return tuple(looks), grams


def look_at(
    space: Space,
    record: Record,
    survey: Survey,
    accepted: tuple[Term, ...],
    last: Grams,
) -> tuple[Looks, Grams]:
    """Scan every axis and test every family and every curve.

    Parameters
    ----------
    space : Space
        Whitened residual.
    record : Record
        Record.
    survey : Survey
        What was planned for it.
    accepted : tuple of Term
        What is already in the model.
    last : Grams
        Gram matrices of the look before.

    Returns
    -------
    looks : Looks
    grams : Grams
        Gram matrices that belong to the noise.
    """
    grams = make_grams(survey, space.whitener, last)
    looks, results = line_looks(space, record, survey, accepted)
    names = {term.cause.name for term in accepted}
    shape = geometry(survey.bank, grams.bank, space)
    looks += _bank_looks(survey.bank, shape, survey.law, space, SHARES["families"], names)
    other = geometry(survey.curves, grams.curves, space)
    looks += _bank_looks(survey.curves, other, survey.curve_law, space, SHARES["curves"], names)
    return Looks(tuple(looks), results, shape, space.whitener), grams
