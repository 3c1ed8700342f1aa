"""What settled means on one bench, in samples and volts."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hdbench.profile.calibrating import CalibrationPlan

__all__ = ["SettleRule", "settle_rule"]


@dataclass(frozen=True, slots=True)
class SettleRule:
    """What settled means.

    Parameters
    ----------
    period_s : float
        Sampling period, s.
    window : int
        Samples per window, >= 2.
    band_v : float
        Largest drift between two windows, V, beside what noise alone explains.
    read_after : int
        Samples after the change of load before which none is averaged.
    limit : int
        Samples after which waiting ends.
    """

    period_s: float
    window: int
    band_v: float
    read_after: int
    limit: int


def settle_rule(plan: CalibrationPlan, read_after_s: float, gain_nm_per_v: float) -> SettleRule:
    """Return the rule of a profile."""
    window = max(2, round(plan.average_s / plan.sample_period_s))
    read_after = math.ceil(read_after_s / plan.sample_period_s)
    limit = read_after + max(2 * window, round(plan.settle_timeout_s / plan.sample_period_s))
    band_v = plan.settle_band_nm / gain_nm_per_v
    return SettleRule(plan.sample_period_s, window, band_v, read_after, limit)
