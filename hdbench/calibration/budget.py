"""A budget of relative standard uncertainties and what it adds up to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

__all__ = ["BudgetRow", "ExpandedUncertainty", "budget_dicts", "combined", "expanded_uncertainty"]

# dof above which Student's t is the normal distribution to four digits of k
_MANY_DOF = 1e6


@dataclass(frozen=True, slots=True)
class BudgetRow:
    """One source of uncertainty.

    Parameters
    ----------
    name : str
        The source.
    group : str
        What it belongs to, such as ``applied torque``.
    half_width : float or None
        Limits +-, or the standard uncertainty where the distribution is ``normal`` or ``t``;
        in `unit`. None: not declared.
    unit : str
        Its unit; ``1`` for a share.
    distribution : str
        ``rectangular``, ``normal``, ``t`` or ``in full``.
    divisor : float
        Half width over standard uncertainty.
    sensitivity : float
        Relative change of the gain per unit.
    relative_std : float
        Its part of the relative standard uncertainty of the gain.
    dof : float or None
        Degrees of freedom; None: known.
    declared : bool
        Whether it has a size; a row without one counts as nothing and says so.
    origin : str
        Certificate or formula; empty: not declared.
    """

    name: str
    group: str
    half_width: float | None
    unit: str
    distribution: str
    divisor: float
    sensitivity: float
    relative_std: float
    dof: float | None
    declared: bool
    origin: str = ""


@dataclass(frozen=True, slots=True)
class ExpandedUncertainty:
    """A standard uncertainty, its degrees of freedom, and the interval they make.

    Parameters
    ----------
    std : float
        Standard uncertainty.
    dof : float or None
        Effective degrees of freedom; None where known.
    coverage_factor : float
        k of 95 % coverage for these degrees of freedom.
    expanded : float
        k times std.
    """

    std: float
    dof: float | None
    coverage_factor: float
    expanded: float

    def to_dict(self, value: float, unit: str) -> dict[str, object]:
        """Return it beside the value it belongs to, as results store it."""
        return {
            "value": value,
            "unit": unit,
            "std": self.std,
            "dof": self.dof,
            "coverage_factor": self.coverage_factor,
            "coverage_probability": 0.95,
            "expanded": self.expanded,
            "expanded_relative": self.expanded / abs(value) if value else None,
        }


def expanded_uncertainty(
    std: float, dof: float | None, confidence: float = 0.95
) -> ExpandedUncertainty:
    """Return the expanded uncertainty with k from the degrees of freedom.

    References
    ----------
    .. [1] JCGM 100:2008, annex G.
    """
    from scipy.special import ndtri, stdtrit

    p = 0.5 + confidence / 2.0
    if dof is None or not dof < _MANY_DOF:
        k = float(ndtri(p))
        return ExpandedUncertainty(std, None, k, k * std)
    k = float(stdtrit(dof, p))
    return ExpandedUncertainty(std, dof, k, k * std)


def combined(parts: Sequence[tuple[float, float | None]]) -> tuple[float, float | None]:
    """Return root sum of squares and effective degrees of freedom.

    References
    ----------
    .. [1] F. E. Satterthwaite, Biometrics Bull. 2 (1946) 110; JCGM 100:2008, equation G.2b.
    """
    variance = math.fsum(std**2 for std, _ in parts)
    loss = math.fsum(std**4 / dof for std, dof in parts if dof is not None)
    return math.sqrt(variance), variance**2 / loss if loss > 0.0 else None


def budget_dicts(rows: Sequence[BudgetRow]) -> list[dict[str, Any]]:
    """Return the rows as results store them, with the share of each in the variance."""
    total = math.fsum(row.relative_std**2 for row in rows)
    return [
        {
            "name": row.name,
            "group": row.group,
            "half_width": row.half_width,
            "unit": row.unit,
            "distribution": row.distribution,
            "divisor": row.divisor,
            "sensitivity": row.sensitivity,
            "relative_std": row.relative_std,
            "dof": row.dof,
            "share": row.relative_std**2 / total if total > 0.0 else 0.0,
            "declared": row.declared,
            "origin": row.origin or "not declared",
        }
        for row in rows
    ]
