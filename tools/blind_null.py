"""False alarms on full simulations of clean records, as a table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from scipy.stats import beta, binom

__all__ = ["NOISES", "table"]

NOISES = ("white", "ar", "flicker")
_WORDS = {"white": "white", "ar": "AR(0.9)", "flicker": "1/f"}


def _interval(events: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of Clopper and Pearson."""
    low = float(beta.ppf(0.025, events, count - events + 1)) if events else 0.0
    high = float(beta.ppf(0.975, events + 1, count - events)) if events < count else 1.0
    return low, high


def table(entries: Sequence[Mapping[str, Any]], alpha: float) -> tuple[list[str], bool]:
    """Return lines of a Markdown table, and whether all counts keep the nominal rate."""
    lines = [
        "| noise | records | nominal rate | with a finding | rate (95 % interval) "
        "| highest count that chance explains (99.9 %) | named | unexplained |",
        "|---|---|---|---|---|---|---|---|",
    ]
    kept = True
    groups = [(_WORDS[kind], [e for e in entries if e["noise"] == kind]) for kind in NOISES]
    for words, some in (*groups, ("all", list(entries))):
        if not some:
            continue
        events = sum(bool(e["names"] or e["places"]) for e in some)
        named, left = sum(bool(e["names"]) for e in some), sum(bool(e["places"]) for e in some)
        low, high = _interval(events, len(some))
        limit = int(binom.ppf(0.999, len(some), alpha))
        kept = kept and events <= limit
        lines.append(
            f"| {words} | {len(some)} | {alpha:.2%} | {events} | {events / len(some):.2%} "
            f"({low:.2%}-{high:.2%}) | {limit} | {named} | {left} |"
        )
    said = Counter(name for e in entries for name in (*e["names"], *e["places"]))
    if said:
        what = ", ".join(f"{name} ({count})" for name, count in said.most_common())
        lines += ["", f"Findings: {what}."]
    return lines, kept
