"""One quantity of two results: its difference against its uncertainty, and what both share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from hdbench.estimation.harmonics import combine
from hdbench.records import Quantity
from hdbench.records.quantity import coverage_factor

# Student's t is the normal distribution to four digits of k from here on
_MANY_DOF = 1e6


@dataclass(frozen=True, slots=True)
class Compared:
    """One quantity of both results.

    Parameters
    ----------
    name : str
        Key, for a program.
    label : str
        Name, for a person.
    unit : str
        Unit; empty for a pure number.
    a, b : Quantity or float or None
        The two; a float where no uncertainty is declared, None where one side has none.
    difference : Quantity or None
        b less a.
    coverage_factor : float or None
        k for the confidence and the degrees of freedom of the difference.
    score : float or None
        Size of the difference over its expanded uncertainty; above 1 it has moved. None where it
        has no uncertainty.
    correlation : float
        Correlation of the two, from what they have in common.
    decides : bool
        Whether the verdict rests on it.
    note : str
        What to know beside it.
    """

    name: str
    label: str
    unit: str
    a: Quantity | float | None
    b: Quantity | float | None
    difference: Quantity | None = None
    coverage_factor: float | None = None
    score: float | None = None
    correlation: float = 0.0
    decides: bool = False
    note: str = ""

    @property
    def moved(self) -> bool | None:
        """Whether it moved beyond its uncertainty; None where that cannot be told."""
        return None if self.score is None else not self.score <= 1.0

    @property
    def expanded(self) -> float | None:
        """Expanded uncertainty of the difference, unit of the quantity."""
        if self.difference is None or self.coverage_factor is None:
            return None
        return self.coverage_factor * self.difference.std

    @property
    def values(self) -> tuple[float | None, float | None]:
        """Both without their uncertainties."""
        a, b = (x.value if isinstance(x, Quantity) else x for x in (self.a, self.b))
        return a, b

    def to_dict(self) -> dict[str, Any]:
        """Return it as ``--json`` prints it."""
        first, second = self.values
        change = second / first - 1.0 if first and second is not None else None
        told = {"relative_change": change, "expanded": self.expanded, "moved": self.moved}
        return {**asdict(self), **told}


@dataclass(frozen=True, slots=True)
class Terms:
    """How two results are held against each other.

    Parameters
    ----------
    confidence : float
        Of the verdict, in (0.5, 1).
    same_origin : bool
        Angle 0 is one mark on the shaft in both runs: then phases count.
    independent : bool
        Take no standard and no gain as common to both.
    """

    confidence: float = 0.95
    same_origin: bool = False
    independent: bool = False

    def level(self, tests: int) -> float:
        """Return the confidence of each of so many tests."""
        return 1.0 - (1.0 - self.confidence) / max(1, tests)


@dataclass(frozen=True, slots=True)
class SharedPart:
    """A part of the uncertainty that both results have from one source.

    Parameters
    ----------
    in_a, in_b : float
        What one standard deviation of the source does to each, with sign, unit of the quantity.
    dof : float or None
        Degrees of freedom of the source; None where known.
    """

    in_a: float
    in_b: float
    dof: float | None = None


def compared(
    named: tuple[str, str, str],
    a: Quantity,
    b: Quantity,
    *,
    common: Sequence[SharedPart] = (),
    confidence: float,
    decides: bool = False,
    note: str = "",
) -> Compared:
    r"""Hold one quantity of two results against each other.

    Notes
    -----
    :math:`u_d^2 = u_a'^2 + u_b'^2 + \sum_i (s_{b,i} - s_{a,i})^2`, u' what is left of each without
    its common parts :math:`s_i`; the same as :math:`u_a^2 + u_b^2 - 2 r u_a u_b` with :math:`r =
    \sum_i s_{a,i} s_{b,i} / u_a u_b`. Score: :math:`|b - a| / (k u_d)`, as the E_n of comparisons
    between laboratories (ISO 13528), with k of the degrees of freedom (`combine`) in place of 2.
    """
    parts = [
        own_part(a, [(part.in_a, part.dof) for part in common]),
        own_part(b, [(part.in_b, part.dof) for part in common]),
    ]
    parts += [(abs(part.in_b - part.in_a), part.dof) for part in common]
    std, dof = combine(*parts)
    difference = Quantity(b.value - a.value, std, dof)
    k = coverage_factor(dof, confidence)
    score = None
    if std > 0.0:
        score = abs(difference.value) / (k * std)
    elif difference.value == 0.0:
        score = 0.0
    product = a.std * b.std
    shared = math.fsum(part.in_a * part.in_b for part in common)
    correlation = max(-1.0, min(1.0, shared / product)) if product > 0.0 else 0.0
    return Compared(*named, a, b, difference, k, score, correlation, decides, note)


def own_part(
    whole: Quantity, common: Sequence[tuple[float, float | None]]
) -> tuple[float, float | None]:
    """Return what is left of an uncertainty without parts of it."""
    std = math.sqrt(max(0.0, whole.std**2 - math.fsum(part**2 for part, _ in common)))
    if whole.dof is None or not (common and std > 0.0):
        return std, whole.dof
    from scipy.special import stdtridf

    taken = math.fsum((coverage_factor(dof) * part) ** 2 for part, dof in common)
    square = (coverage_factor(whole.dof) * whole.std) ** 2 - taken
    factor = math.sqrt(square) / std if square > 0.0 else math.inf
    # two sigma factors bound what can be: the normal one, and that of one degree of freedom
    if factor <= coverage_factor(None) * (1.0 + 1e-6):
        return std, None
    return std, float(stdtridf(0.975, factor)) if factor <= coverage_factor(1.0) else whole.dof


def region(size: int, confidence: float, dof: float | None) -> float:
    """Return the quantile that ``d C^-1 d`` of a vector is held against."""
    from scipy.special import chdtri, fdtri

    if dof is None or dof > _MANY_DOF:
        return float(chdtri(size, 1.0 - confidence))
    return size * float(fdtri(size, dof, confidence))
