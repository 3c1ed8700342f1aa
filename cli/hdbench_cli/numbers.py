"""Numbers for people: as many digits as the uncertainty allows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["probability", "show_remarks", "with_uncertainty"]


def with_uncertainty(quantity: Mapping[str, Any], unit: str) -> str:
    """Return ``value +- std unit`` with two significant digits of the standard uncertainty.

    Examples
    --------
    >>> with_uncertainty({"value": 6.6123, "std": 0.0484, "dof": 3}, "N m/V")
    '6.612 +- 0.048 N m/V (3 dof)'
    """
    value, std = float(quantity["value"]), float(quantity["std"])
    if std == 0.0:
        return f"{value:.6g} {unit}"
    digits = max(0, 1 - math.floor(math.log10(std)))
    dof = quantity.get("dof")
    tail = f" ({dof:.3g} dof)" if dof is not None else ""
    return f"{value:.{digits}f} +- {std:.{digits}f} {unit}{tail}"


def probability(value: float) -> str:
    """Return a false-alarm probability in words: nothing is impossible, only below 1e-9.

    Examples
    --------
    >>> probability(0.0021), probability(0.0)
    ('0.0021', 'below 1e-9')
    """
    return "below 1e-9" if value < 1e-9 else f"{value:.2g}"


def show_remarks(console: Console, result: Mapping[str, Any]) -> None:
    """Draw what makes a result doubtful (flags) and what limits it (notes)."""
    for kind in ("flags", "notes"):
        for remark in result.get(kind, ()):
            line = f"{kind[:-1]:13s} {remark['name']}: {remark['detail']}"
            console.print(line, markup=False, soft_wrap=True)
