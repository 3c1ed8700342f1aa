"""What the baseline of a diagnosis took, and what the motion cannot tell from it, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench_cli.numbers import with_uncertainty

__all__ = ["baseline_lines"]


def baseline_lines(settings: Mapping[str, Any], label: int) -> list[str]:
    """Return what a diagnosis tells of its baseline."""
    lines = []
    ripple = [
        f"order {one['order']:g}: {_amplitude(one)}" for one in settings.get("baseline_ripple", ())
    ]
    if ripple:
        lines.append(f"{'baseline':<{label}}ripple of {', '.join(ripple)}")
    alike = settings.get("not_told_from_zero", ())
    if alike:
        shares = [100.0 * one["own_share"] for one in alike]
        low, high = f"{min(shares):.0f}", f"{max(shares):.0f}"
        own = f"{low} %" if low == high else f"{low} to {high} %"
        names = ", ".join(one["cause"] for one in alike)
        lines.append(f"{'cannot tell':<{label}} the zero from {names} ({own} of its own)")
    return lines


def _amplitude(one: Mapping[str, Any]) -> str:
    entry = {"value": one["amplitude_nm"], "std": one["std_nm"], "dof": None}
    return with_uncertainty(entry, "N m")
