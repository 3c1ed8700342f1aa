"""Every setting of an acquisition, each echoed as it was sent."""

from __future__ import annotations

from hdbench.drivers.dataq.commands import Commands
from hdbench.drivers.dataq.models import Model
from hdbench.drivers.dataq.rates import RateSetting, choose_rate, packet_code
from hdbench.drivers.dataq.scanlist import ScanPlan

__all__ = ["set_up"]


def set_up(
    commands: Commands, model: Model, plan: ScanPlan, period_s: float, average: int
) -> RateSetting:
    """Send packet size, encoding, scan list and rate."""
    rate = choose_rate(model, len(plan.words), period_s, average)
    lines = [f"ps {packet_code(len(plan.words), rate.period_s)}", "encode 0"]
    lines += [f"slist {position} {word}" for position, word in enumerate(plan.words)]
    lines.append(f"srate {rate.srate}")
    if model.dec_max > 1:
        lines.append(f"dec {rate.dec}")
        lines.append(f"filter * {int(average > 1)}")
    if model.deca_max > 1:
        lines.append(f"deca {rate.deca}")
    for line in lines:
        commands.set(line)
    return rate
