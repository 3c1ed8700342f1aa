"""The picture of the live view; it fits 80 columns and 24 lines."""

from __future__ import annotations

import math
import os
import sys
from typing import TYPE_CHECKING

from rich.console import Group
from rich.text import Text

from hdbench_cli.live.history import CURVES, Curve, History, Order
from hdbench_cli.text import sparkline

if TYPE_CHECKING:
    from hdbench.profile import Profile

_LABEL, _NUMBER, _LIMIT = 9, 18, 12
# a screen of fewer columns has no place for the word beside the share of a limit
_NARROW, _NARROW_LIMIT = 56, 6
# beyond four fifths of a limit a person should look
_NEAR = 0.8
# an amplitude has settled once it moved by less than a twentieth of itself for two seconds
_SETTLED = 0.05
_MOST_ORDERS = 8


def picture(history: History, profile: Profile, words: tuple[str, str], width: int) -> Group:
    """Return everything to be seen at this moment."""
    room = max(40, min(width, 140)) - 1
    heading, free = words
    lines = [Text(heading[:room], style="bold"), _bar(history, room)]
    lines += [*_counts(history, free, room), Text()]
    lines += [_curve(history, curve, profile, room) for curve in CURVES]
    orders = history.orders()[:_MOST_ORDERS]
    if orders:
        lines.append(Text())
        scale = history.largest_amplitude_nm()
        lines += [_order(found, scale, room) for found in orders]
    return Group(*lines)


def _plain() -> bool:
    # while a live display runs, stderr is a stand-in that names no encoding of its own
    stream = getattr(sys.stderr, "rich_proxied_file", sys.stderr)
    encoding = (stream.encoding or "").lower()
    return "utf" not in encoding or os.environ.get("TERM", "") in ("", "dumb")


def _bar(history: History, room: int) -> Text:
    last = history.last
    if last is None or not math.isfinite(last.total_s) or last.total_s <= 0.0:
        done = 0.0 if last is None else last.done_s
        return Text(f"{done:.0f} s so far; Ctrl-C ends it")
    eta = history.eta_s()
    left = f"  {eta:.0f} s left" if math.isfinite(eta) else ""
    tail = f" {last.done_s:.0f} of {last.total_s:.0f} s{left}"
    wide = max(5, room - len(tail))
    full = round(wide * min(1.0, last.done_s / last.total_s))
    on, off = ("#", "-") if _plain() else ("━", "─")
    return Text.assemble((on * full, "green"), (off * (wide - full), "dim"), tail)


def _counts(history: History, free: str, room: int) -> list[Text]:
    """Return what is counted, on as many lines as it takes."""
    last = history.last
    if last is None:
        return []
    rate = history.rate_hz()
    parts = [
        (f"{rate:.0f} samples/s" if math.isfinite(rate) else "- samples/s", ""),
        (f"lost {last.lost}", "bold red" if last.lost else "green"),
        (f"saturated {last.saturated}", "bold red" if last.saturated else "green"),
        (f"retries {last.retries}", "yellow" if last.retries else "green"),
        (f"waiting {last.depth}", ""),
        (f"disk {free}", ""),
    ]
    lines = [Text()]
    for words, style in parts:
        if len(lines[-1]) + len(words) > room:
            lines.append(Text())
        lines[-1].append(words, style=style)
        lines[-1].append("  ")
    for line in lines:
        line.truncate(room)
    return lines


def _curve(history: History, curve: Curve, profile: Profile, room: int) -> Text:
    narrow = room < _NARROW
    wide = max(5, room - _LABEL - _NUMBER - (_NARROW_LIMIT if narrow else _LIMIT) - 2)
    points = history.curve(curve, wide)
    same = [history.curve(c, wide) for c in CURVES if c.scale == curve.scale]
    values = [float(v) for part in same for v in part if math.isfinite(v)]
    low, high = (min(values), max(values)) if values else (0.0, 0.0)
    # a constant is drawn in the middle, not stretched to its own noise
    least = 0.02 * max(abs(low), abs(high), 1e-9)
    if high - low < least:
        low, high = low - least, high + least
    drawn = sparkline([float(v) for v in points], wide, (low, high), plain=_plain())
    # full blocks of two lines grow together
    drawn = drawn.replace("█", "▇")
    value = history.newest(curve)
    number = f"{value:+.3f} {curve.unit}" if math.isfinite(value) else f"- {curve.unit}"
    text = Text(f"{curve.label:{_LABEL}}{number:>{_NUMBER - 2}}  ")
    text.append(f"{drawn:{wide}}", style="cyan")
    limit = _limit(curve, profile)
    largest = history.largest(curve.column)
    if limit is not None and math.isfinite(largest):
        share = largest / limit
        style = "bold red" if share > 1.0 else "yellow" if share > _NEAR else "green"
        words = f" {100.0 * share:3.0f} %" if narrow else f" {100.0 * share:4.0f} % limit"
        text.append(words, style=style)
    return text


def _limit(curve: Curve, profile: Profile) -> float | None:
    limits = profile.data.limits
    return {
        "motor_velocity_rad_s": limits.velocity_rad_s,
        "torque_nm": limits.torque_nm,
        "motor_current_a": limits.current_a,
    }.get(curve.column)


def _order(found: Order, scale: float, room: int) -> Text:
    spread = f" +- {found.spread_nm:.3f}" if math.isfinite(found.spread_nm) else ""
    number = f"{found.amplitude_nm:.3f}{spread} N m"
    wide = max(8, room - _LABEL - 3 - len(number) - 2)
    full = round(wide * min(1.0, found.amplitude_nm / scale if scale > 0.0 else 0.0))
    settled = found.spread_nm <= _SETTLED * found.amplitude_nm
    on, off = ("#", ".") if _plain() else ("▇", "▁")
    text = Text(f"{found.name:{_LABEL + 3}}")
    text.append(on * full, style="green" if settled else "yellow")
    text.append(off * (wide - full), style="dim")
    text.append(f"  {number}")
    return text
