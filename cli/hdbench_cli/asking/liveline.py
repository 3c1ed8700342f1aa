"""How a reading settles, in one line."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hdbench.session.calibrating.conversation import LiveReading

__all__ = ["live_line"]

_BAR = 10


def live_line(live: LiveReading) -> str:
    """Return how a reading settles, in one line of less than 80 characters."""
    full = round(_BAR * min(1.0, max(0.0, live.share)))
    bar = "#" * full + "." * (_BAR - full)
    swing = "" if live.swing_period_s is None else f" swing {live.swing_period_s:.2f} s"
    return (
        f"{live.value_v:+.4f} V {live.torque_nm:+.3f} N m {1e3 * live.slope_v_s:+.1f} mV/s "
        f"band {1e3 * live.spread_v:.1f} mV [{bar}] {max(0.0, live.remaining_s):.1f} s{swing}"
    )
