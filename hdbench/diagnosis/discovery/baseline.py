"""Terms that a user adds to the baseline of a diagnosis or takes out of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.errors import UsageError
from hdbench.model import Motion
from hdbench.model.bench import expected_torque_nm
from hdbench.records.trace import FloatArray

_REMOVABLE = ("misalignment", "load", "expected-torque")
# orders closer than this are one: no record of this bench tells them apart
_SAME_ORDER = 1e-6


@dataclass(frozen=True, slots=True)
class BaselineChange:
    """What is added to the contract's baseline and taken out of it.

    Parameters
    ----------
    without : frozenset of str
        ``misalignment``, ``load`` or ``expected-torque``.
    without_orders : tuple of float
        Motor orders that are taken out.
    orders : tuple of float
        Motor orders that are added.
    """

    without: frozenset[str] = frozenset()
    without_orders: tuple[float, ...] = ()
    orders: tuple[float, ...] = ()

    def apply(
        self,
        motion: Motion,
        fixed_nm: FloatArray,
        names: tuple[str, ...],
        columns: FloatArray,
    ) -> tuple[FloatArray, tuple[str, ...], FloatArray]:
        """Return fixed torque, names and columns of the changed baseline."""
        if "expected-torque" in self.without:
            fixed_nm = fixed_nm - expected_torque_nm(motion, motion.inertia_nm_s2)
        kept = [index for index, name in enumerate(names) if self._keeps(name)]
        names, parts = tuple(names[index] for index in kept), [columns[:, kept]]
        for order in self.orders:
            if not any(_is_order(name, order) for name in names):
                names += (f"ripple:{order!r}:cosine", f"ripple:{order!r}:sine")
                phase = order * motion.angle_rad
                parts.append(np.column_stack([np.cos(phase), np.sin(phase)]))
        return fixed_nm, names, np.hstack(parts)

    def _keeps(self, name: str) -> bool:
        if name.startswith("misalignment"):
            return "misalignment" not in self.without
        return not any(_is_order(name, order) for order in self.without_orders)


def _is_order(name: str, order: float) -> bool:
    parts = name.split(":")
    return parts[0] == "ripple" and abs(float(parts[1]) - order) <= _SAME_ORDER


def parse_baseline(terms: Sequence[str]) -> BaselineChange:
    """Return what terms such as ``-misalignment`` or ``+order:6`` ask for."""
    without: list[str] = []
    removed: list[float] = []
    added: list[float] = []
    for term in terms:
        sign, name = term[:1], term[1:]
        order = _order(name)
        if order is not None and sign in ("+", "-"):
            (added if sign == "+" else removed).append(order)
        elif sign == "-" and name in _REMOVABLE:
            without.append(name)
        else:
            raise UsageError(
                f"baseline term {term!r}; needed: -misalignment, -load, -expected-torque, "
                "-order:NUMBER or +order:NUMBER",
                where="--baseline",
                fix="name a term of the baseline with its sign, such as --baseline=-misalignment",
            )
    return BaselineChange(frozenset(without), tuple(removed), tuple(added))


def _order(name: str) -> float | None:
    """Return the order that a term names, None where it names none."""
    if not name.startswith("order:"):
        return None
    try:
        value = float(name.removeprefix("order:"))
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0.0 else None
