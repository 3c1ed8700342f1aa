"""Everything that is planned once for the motion of a record, and how noise alone fares in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gamma, gammaincc

from hdbench.diagnosis.detect.bank import Bank, Grams, bank_gram, build_bank
from hdbench.diagnosis.detect.geometry import geometry
from hdbench.diagnosis.detect.law import Law, draw_law
from hdbench.diagnosis.detect.scan import null_scans, upcrossing_rate
from hdbench.diagnosis.detect.scanplan import LineScan
from hdbench.diagnosis.detect.steps import step_statistics
from hdbench.diagnosis.fit.families import family_causes, is_line, is_step
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.curves import curve_causes
from hdbench.diagnosis.noise.whitened import Space
from hdbench.model import Cause
from hdbench.records.trace import FloatArray

__all__ = ["KnownPlaces", "LineLaw", "Survey", "make_survey"]

# draws of white noise through the scans: hundreds of upcrossings each, rates to a few per cent
_DRAWS = 6
# draws for the largest statistic of a step: its median to 10 % in probability
_STEP_DRAWS = 24
# motor orders at which gears, bearings and poles put their ripple
_KNOWN_ORDERS = range(1, 13)
# a known order is looked for within this many resolution cells
_NEAR = 0.5
_SMALLEST = 1e-300
# half a statistic from which its tail is its leading term to a per cent
_FAR = 100.0


@dataclass(frozen=True, slots=True)
class LineLaw:
    """Probability of the largest statistic along a scan, without an effect.

    Parameters
    ----------
    rate : float
        W of `upcrossing_rate`.
    dof : int
        Degrees of freedom at one place.
    places : float
        Number of separate stretches that are scanned.
    """

    rate: float
    dof: int = 2
    places: float = 1.0

    def trials(self, statistic: float) -> float:
        """Return the effective number of independent places at a statistic."""
        half = 0.5 * max(statistic, 0.0)
        if half > _FAR:
            # upcrossings over the tail of chi^2, both far out
            return self.places + self.rate * float(gamma(0.5 * self.dof) * np.sqrt(half))
        rise = half ** (0.5 * (self.dof - 1)) * np.exp(-half)
        return self.places + self.rate * float(rise) / float(gammaincc(0.5 * self.dof, half))

    def probability(self, statistic: float) -> float:
        """Return the probability of that or more anywhere in the scan, in (0, 1]."""
        half = 0.5 * max(statistic, 0.0)
        local = float(gammaincc(0.5 * self.dof, half))
        chance = self.places * local
        chance += self.rate * float(half ** (0.5 * (self.dof - 1)) * np.exp(-half))
        return float(np.clip(chance, _SMALLEST, 1.0))


@dataclass(frozen=True, slots=True)
class KnownPlaces:
    """Places of a scan that are looked at with a rate of their own.

    Parameters
    ----------
    name : str
        Name of the look.
    scan : int
        Index of the scan.
    inside : ndarray of bool, shape (n_grid,)
        Grid points that belong to it.
    law : LineLaw
        Its law.
    """

    name: str
    scan: int
    inside: NDArray[np.bool_]
    law: LineLaw


@dataclass(frozen=True, slots=True)
class Survey:
    """Plan of all looks at a record.

    Parameters
    ----------
    causes : tuple of Cause
        Catalogue.
    scans : tuple of LineScan
        Scans.
    scan_laws : tuple of LineLaw
        Their laws.
    combs : tuple of (Cause, LineLaw)
        Causes with harmonics of one order, found along the scan over motor order.
    known : tuple of KnownPlaces
        Known places.
    steps : tuple of (Cause, LineLaw)
        Steps of the zero, looked for at every sample.
    bank, curves : Bank
        Families of the catalogue, and curves without a name.
    law, curve_law : Law
        Their laws.
    """

    causes: tuple[Cause, ...]
    scans: tuple[LineScan, ...]
    scan_laws: tuple[LineLaw, ...]
    combs: tuple[tuple[Cause, LineLaw], ...]
    known: tuple[KnownPlaces, ...]
    steps: tuple[tuple[Cause, LineLaw], ...]
    bank: Bank
    curves: Bank
    law: Law
    curve_law: Law


def comb_statistic(statistic: FloatArray, first: int, harmonics: int) -> FloatArray:
    """Return the sum of a line's statistic over its harmonics.

    Parameters
    ----------
    statistic : ndarray, shape (n_grid,)
        Statistic of a line on a grid whose point i stands for ``(first + i)`` steps.
    first : int
        Index of the first point.
    harmonics : int
        Harmonics summed over.

    Returns
    -------
    ndarray, shape (m,)
        At those of the first grid points whose harmonics all lie on the grid.
    """
    last = (first + len(statistic) - 1) // harmonics
    index = np.arange(first, last + 1)
    return np.asarray(sum(statistic[k * index - first] for k in range(1, harmonics + 1)))


def _combs(
    scan: LineScan, causes: tuple[Cause, ...], nulls: list[FloatArray]
) -> tuple[tuple[Cause, LineLaw], ...]:
    first = scan.single.first
    found = []
    for cause in causes:
        harmonics = len(cause.linear) // 2
        if not (is_line(cause) and cause.shape[0].name == "order" and harmonics > 1):
            continue
        sums = [comb_statistic(null, first, harmonics) for null in nulls]
        if len(sums[0]):
            found.append((cause, LineLaw(upcrossing_rate(sums, 2 * harmonics), 2 * harmonics)))
    return tuple(found)


def _known(
    record: Record, scans: tuple[LineScan, ...], laws: list[LineLaw], causes: tuple[Cause, ...]
) -> tuple[KnownPlaces, ...]:
    """Return integer motor orders, and the bands of causes that have narrow ones."""
    found = []
    for at, (scan, law) in enumerate(zip(scans, laws, strict=True)):
        grid = scan.single.grid
        if scan.domain == "motor-order":
            factor = record.motion.gauge_factor
            orders = {k * f for k in _KNOWN_ORDERS for f in (1.0, factor)}
            inside = np.zeros(len(grid), dtype=bool)
            for order in orders:
                inside |= np.abs(grid - order) <= _NEAR / scan.span
            known = LineLaw(law.rate * float(inside.mean()), 2, float(len(orders)))
            found.append(KnownPlaces("known orders", at, inside, known))
        if scan.domain == "frequency":
            for cause in causes:
                bands = cause.shape[0].bands if is_line(cause) else ()
                inside = np.zeros(len(grid), dtype=bool)
                for low, high in bands:
                    inside |= (grid >= low) & (grid <= high)
                if inside.any() and cause.shape[0].name == "frequency_hz":
                    known = LineLaw(law.rate * float(inside.mean()), 2, float(len(bands)))
                    found.append(KnownPlaces(cause.name, at, inside, known))
    return tuple(k for k in found if k.inside.any())


def make_survey(
    record: Record,
    causes: tuple[Cause, ...],
    space: Space,
    scans: tuple[LineScan, ...],
    rng: np.random.Generator,
) -> tuple[Survey, Grams]:
    """Plan all looks at a record and draw how noise alone fares in them.

    Parameters
    ----------
    record : Record
        Record.
    causes : tuple of Cause
        Catalogue.
    space : Space
        Whitened residual of the baseline: its geometry calibrates every look.
    scans : tuple of LineScan
        Planned scans.
    rng : Generator
        For the draws.

    Returns
    -------
    survey : Survey
    grams : Grams
        Gram matrices of its banks in the noise of `space`.
    """
    lines = tuple(c for c in causes if is_line(c) and c.applicable(record.motion) is None)
    pulls = space.null_pulls(_DRAWS, rng)
    laws: list[LineLaw] = []
    combs: tuple[tuple[Cause, LineLaw], ...] = ()
    for scan in scans:
        nulls = list(null_scans(space, scan, pulls))
        laws.append(LineLaw(upcrossing_rate(nulls)))
        if scan.domain == "motor-order":
            combs = _combs(scan, lines, nulls)
    bank = build_bank(record, family_causes(record, causes))
    curves = build_bank(record, curve_causes(record))
    white = space.whitener
    grams = Grams(white, bank_gram(bank, white), bank_gram(curves, white))
    drawn = [
        draw_law(part, gram, geometry(part, gram, space), space, rng)
        for part, gram in ((bank, grams.bank), (curves, grams.curves))
    ]
    known = _known(record, scans, laws, lines)
    steps = tuple((cause, _step_law(space, rng)) for cause in causes if is_step(cause))
    plan = Survey(causes, scans, tuple(laws), combs, known, steps, bank, curves, drawn[0], drawn[1])
    return plan, grams


def _step_law(space: Space, rng: np.random.Generator) -> LineLaw:
    """Return the law of the largest statistic of a step: its paths are rough, W goes with sqrt(c).

    The median of the largest of some draws fixes W.
    """
    pulls = space.null_pulls(_STEP_DRAWS, rng)
    median = float(np.median(step_statistics(space, pulls).max(axis=0)))
    # P_1 + W sqrt(c / 2) exp(-c / 2) = 1/2: a law of three degrees of freedom in its tail
    local = float(gammaincc(0.5, 0.5 * median))
    rate = (0.5 - local) / (np.sqrt(0.5 * median) * np.exp(-0.5 * median))
    return LineLaw(max(rate, 0.0), 2, 1.0)
