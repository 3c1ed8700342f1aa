"""Looks along scans, at known places and at harmonics of any order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.detect.exact import exact_statistic
from hdbench.diagnosis.detect.scan import ScanResult, scan_line
from hdbench.diagnosis.detect.scanplan import LineScan
from hdbench.diagnosis.detect.steps import step_statistics
from hdbench.diagnosis.detect.survey import LineLaw, Survey, comb_statistic
from hdbench.diagnosis.fit.terms import Term, term_columns
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.nameless import line_terms
from hdbench.diagnosis.noise.whitened import Space
from hdbench.records.trace import FloatArray

__all__ = ["SHARES", "Look", "line_looks"]

# how the false-alarm rate of a record is divided: families together, known places together, each
# scan, harmonics of any order, curves together, slow noise, and what is no torque (`tests`)
SHARES = {
    "families": 0.54,
    "known": 0.14,
    "motor-order": 0.05,
    "frequency": 0.07,
    "output-order": 0.03,
    "combs": 0.03,
    "curves": 0.07,
    "slow": 0.03,
    "tests": 0.04,
}
# peaks of a scan that are tried exactly at most: a scan takes the whitener for its response at the
# line's rate, which is wrong where little is left of a line beside the explained ones
_PEAKS = 12
# a line this close to an accepted one, in resolution cells, is that one's own sidelobe
_OWN = 1.5


@dataclass(frozen=True, slots=True)
class Look:
    """The best of one look.

    Parameters
    ----------
    name : str
        Domain of a scan, name of a family, or of a known place.
    terms : tuple of Term
        What it may be.
    statistic : float
        Statistic at the best place.
    trials : float
        Effective number of independent places that were tried; of a family, of the shapes that the
        residual tells from the best one.
    false_alarm : float
        Probability of that or more anywhere on this record without any effect.
    dof : int
        Degrees of freedom at one place.
    """

    name: str
    terms: tuple[Term, ...]
    statistic: float
    trials: float
    false_alarm: float
    dof: int = 2


def _not_own(scan: LineScan, terms: tuple[Term, ...]) -> FloatArray:
    """Return 0 at places that belong to an accepted line, else 1."""
    keep = np.ones(len(scan.single.grid))
    for term in terms:
        on_output = term.cause.locked_to == "output"
        key = "frequency_hz" if scan.domain == "frequency" else "order"
        if key not in term.shape or on_output != (scan.domain == "output-order"):
            continue
        keep[np.abs(scan.single.grid - term.shape[key]) < _OWN / scan.span] = 0.0
    return keep


def _best_place(
    space: Space, record: Record, scan: LineScan, kept: FloatArray
) -> tuple[float, float]:
    """Return the place of the best line and its exact statistic.

    Peaks are tried in falling order until the best exact value is above what is left of them.
    """
    inner = np.arange(1, len(kept) - 1)
    tops = inner[(kept[inner] >= kept[inner - 1]) & (kept[inner] >= kept[inner + 1])]
    tops = np.concatenate([tops, [0, len(kept) - 1]])
    place, best = float(scan.single.grid[tops[0]]), 0.0
    strongest = tops[np.argsort(-kept[tops], kind="stable")[:_PEAKS]]
    for at in strongest:
        if kept[at] <= best:
            break
        phase = 2.0 * np.pi * scan.single.grid[at] * scan.positions
        columns = np.column_stack([np.cos(phase), np.sin(phase)])
        value = exact_statistic(space, np.where(record.valid[:, None], columns, 0.0))[0]
        if value > best:
            place, best = float(scan.single.grid[at]), value
    return place, best


def line_looks(
    space: Space, record: Record, survey: Survey, accepted: tuple[Term, ...]
) -> tuple[list[Look], dict[str, ScanResult]]:
    """Return looks along every scan, at known places and at harmonics of any order.

    Parameters
    ----------
    space : Space
        Whitened residual.
    record : Record
        Record.
    survey : Survey
        What was planned for it.
    accepted : tuple of Term
        What is already in the model: its own sidelobes are not looked at.

    Returns
    -------
    looks : list of Look
    results : dict of str to ScanResult
        By domain.
    """
    looks, results, statistics = [], {}, []

    def add(name: str, scan: LineScan, kept: FloatArray, law: LineLaw, share: float) -> None:
        place, best = float(scan.single.grid[np.argmax(kept)]), float(kept.max())
        # what is no alarm by far needs no exact value
        if law.probability(best) < share:
            place, best = _best_place(space, record, scan, kept)
        terms = line_terms(scan.domain, place, survey.causes, record.motion, 1.0 / scan.span)
        chance = min(1.0, law.probability(best) / share)
        looks.append(Look(name, tuple(terms), best, law.trials(best), chance))

    for scan, law in zip(survey.scans, survey.scan_laws, strict=True):
        result = scan_line(space, scan)
        results[scan.domain] = result
        statistics.append(result.statistic * _not_own(scan, accepted))
        add(scan.domain, scan, statistics[-1], law, SHARES[scan.domain])
        if scan.domain == "motor-order":
            looks += _comb_looks(space, record, survey, scan, statistics[-1])
    looks += _step_looks(space, record, survey)
    for known in survey.known:
        kept = np.where(known.inside, statistics[known.scan], 0.0)
        share = SHARES["known"] / len(survey.known)
        add(known.name, survey.scans[known.scan], kept, known.law, share)
    return looks, results


def _step_looks(space: Space, record: Record, survey: Survey) -> list[Look]:
    """Return the best step of the zero; a family among the others."""
    looks = []
    for cause, law in survey.steps:
        statistic = step_statistics(space, space.pull[:, None])[:, 0]
        place = float(record.motion.time_s[int(np.argmax(statistic))])
        term = Term(cause, {"step_time_s": place})
        best, dof, _ = exact_statistic(space, term_columns(term, record))
        chance = law.probability(best) * (survey.law.together + 1.0) / SHARES["families"]
        looks.append(Look(cause.name, (term,), best, law.trials(best), min(1.0, chance), dof))
    return looks


def _comb_looks(
    space: Space, record: Record, survey: Survey, scan: LineScan, statistic: FloatArray
) -> list[Look]:
    looks = []
    for cause, law in survey.combs:
        sums = comb_statistic(statistic, scan.single.first, len(cause.linear) // 2)
        at = int(np.argmax(sums))
        place = float(scan.single.grid[at])
        if not cause.shape[0].contains(place):
            continue
        term = Term(cause, {"order": place})
        best, dof, _ = exact_statistic(space, term_columns(term, record))
        chance = law.probability(best) * len(survey.combs) / SHARES["combs"]
        looks.append(Look(cause.name, (term,), best, law.trials(best), min(1.0, chance), dof))
    return looks
