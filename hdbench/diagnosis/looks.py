"""All looks at one residual, each with its share of the false-alarm rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.challengers import CHALLENGERS, Left
from hdbench.diagnosis.families import FamilyHit, exact_statistic, family_causes, scan_family
from hdbench.diagnosis.naming import line_terms
from hdbench.diagnosis.record import Record
from hdbench.diagnosis.scan import LineScan, ScanResult, scan_line
from hdbench.diagnosis.terms import Term
from hdbench.diagnosis.whitened import Space
from hdbench.model import Cause
from hdbench.records.trace import FloatArray

__all__ = ["Look", "Looks", "challenge", "line_p_value", "look_at", "look_shares"]

# how the false-alarm rate of a record is divided; the shares add up to one
_SHARES = {"motor-order": 0.25, "output-order": 0.1, "frequency": 0.25}
_FAMILY_SHARE = 0.2
_CHALLENGER_SHARE = 0.2
# draws of white noise through the scans: hundreds of upcrossings each, rates to a few per cent
_DRAWS = 16
_SMALLEST = 1e-300
# peaks of a scan that are tried exactly at most: a scan takes the whitener for its response at the
# line's rate, which is wrong where little is left of a line beside the explained ones
_PEAKS = 24
# a line this close to an accepted one, in resolution cells, is that one's own sidelobe
_OWN = 1.5


@dataclass(frozen=True, slots=True)
class Look:
    """The best of one look.

    Parameters
    ----------
    name : str
        Domain of a scan, or name of a family.
    terms : tuple of Term
        What it may be.
    statistic : float
        Statistic at the best place.
    false_alarm : float
        Probability of that or more anywhere on this record without any effect.
    """

    name: str
    terms: tuple[Term, ...]
    statistic: float
    false_alarm: float


@dataclass(frozen=True, slots=True)
class Looks:
    """Every look at one residual.

    Parameters
    ----------
    looks : tuple of Look
        Scans, then families.
    scans : mapping of str to ScanResult
        By domain.
    families : tuple of FamilyHit
        Best member of each family.
    """

    looks: tuple[Look, ...]
    scans: dict[str, ScanResult]
    families: tuple[FamilyHit, ...]


def look_shares(n_families: int) -> dict[str, float]:
    """Return the share of the false-alarm rate of each scan, a family and a challenger.

    Parameters
    ----------
    n_families : int
        Families that are tested on the record.

    Returns
    -------
    dict of str to float
        By domain of a scan, ``family`` for one family and ``challenger`` for one challenger; all
        scans, families and challengers together make 1.
    """
    return {
        **_SHARES,
        "family": _FAMILY_SHARE / max(1, n_families),
        "challenger": _CHALLENGER_SHARE / len(CHALLENGERS),
    }


def line_p_value(statistic: float, rate: float) -> float:
    """Return the probability that a scan of white noise reaches a statistic.

    Parameters
    ----------
    statistic : float
        chi^2 with two degrees of freedom at the best place.
    rate : float
        W of `upcrossing_rate`.

    Returns
    -------
    float
        ``exp(-c/2) (1 + W sqrt(c))``, in (0, 1].
    """
    tail = float(np.exp(-0.5 * statistic))
    # a probability below the smallest normal double is not zero
    chance = tail * (1.0 + rate * float(np.sqrt(max(statistic, 0.0))))
    return float(np.clip(chance, _SMALLEST, 1.0))


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
    for at in tops[np.argsort(-kept[tops], kind="stable")][:_PEAKS]:
        if kept[at] <= best:
            break
        phase = 2.0 * np.pi * scan.single.grid[at] * scan.positions
        columns = np.column_stack([np.cos(phase), np.sin(phase)])
        value = exact_statistic(space, np.where(record.valid[:, None], columns, 0.0))[0]
        if value > best:
            place, best = float(scan.single.grid[at]), value
    return place, best


def look_at(
    space: Space,
    record: Record,
    scans: tuple[LineScan, ...],
    causes: tuple[Cause, ...],
    accepted: tuple[Term, ...],
    rng: np.random.Generator,
) -> Looks:
    """Scan every axis and test every family.

    Parameters
    ----------
    space : Space
        Whitened residual.
    record : Record
        Record.
    scans : tuple of LineScan
        Planned scans.
    causes : tuple of Cause
        Catalogue.
    accepted : tuple of Term
        What is already in the model.
    rng : Generator
        For the draws of the null.

    Returns
    -------
    Looks
    """
    pulls = space.null_pulls(_DRAWS, rng)
    names = {term.cause.name for term in accepted}
    tested = tuple(c for c in family_causes(record, causes) if c.name not in names)
    shares = look_shares(len(tested))
    looks, results = [], {}
    for scan in scans:
        result = scan_line(space, scan, pulls)
        results[scan.domain] = result
        kept = result.statistic * _not_own(scan, accepted)
        place, best = _best_place(space, record, scan, kept)
        terms = line_terms(scan.domain, place, causes, record.motion, 1.0 / scan.span)
        chance = line_p_value(best, result.rate) / shares[scan.domain]
        looks.append(Look(scan.domain, tuple(terms), best, min(1.0, chance)))
    hits = [hit for cause in tested if (hit := scan_family(space, record, cause)) is not None]
    for hit in hits:
        chance = min(1.0, max(hit.p_value, _SMALLEST) / shares["family"])
        looks.append(Look(hit.term.cause.name, (hit.term,), hit.statistic, chance))
    return Looks(tuple(looks), results, tuple(hits))


def challenge(space: Space, record: Record, noise_nm: float, alpha: float) -> list[Left]:
    """Return the challengers that pass their share of the false-alarm rate, surest first.

    Parameters
    ----------
    space : Space
        Whitened residual with what is explained projected out.
    record : Record
        Record.
    noise_nm : float
        Standard deviation of the noise's innovation, N m.
    alpha : float
        False-alarm rate of the record, in (0, 1).

    Returns
    -------
    list of Left
    """
    share = look_shares(1)["challenger"]
    found = [left for test in CHALLENGERS if (left := test(space, record, noise_nm)) is not None]
    passed = [left for left in found if left.p_value / share < alpha]
    return sorted(passed, key=lambda left: left.p_value)
