"""What is shown while a reading settles."""

from __future__ import annotations

from hdbench.session.calibrating.conversation import LiveReading
from hdbench.session.calibrating.points import Point
from hdbench.session.calibrating.rule import SettleRule
from hdbench.session.calibrating.settle import Judgement

__all__ = ["live_reading"]


def live_reading(
    point: Point, judged: Judgement, rule: SettleRule, waited_s: float, torque_nm: float
) -> LiveReading:
    """Return what a person sees of one moment."""
    needed_s = rule.window * rule.period_s
    earliest_s = rule.read_after * rule.period_s + needed_s
    return LiveReading(
        label=point.label,
        value_v=judged.value_v,
        slope_v_s=judged.slope_v_s,
        spread_v=judged.spread_v,
        torque_nm=torque_nm,
        share=judged.share,
        remaining_s=max((1.0 - judged.share) * needed_s, earliest_s - waited_s),
        waited_s=waited_s,
        limit_s=rule.limit * rule.period_s,
        swing_period_s=None if judged.swing is None else judged.swing.period_s,
    )
