"""Where the gauges sit: on a flexspline that stands or turns."""

from __future__ import annotations

from hdbench.profile.schema import Drive

__all__ = ["gauge_order_factor"]


def gauge_order_factor(drive: Drive) -> float:
    r"""Return the factor from orders relative to the gauges to motor orders.

    Parameters
    ----------
    drive : Drive
        Gear ratio and whether the flexspline with its gauges stands or turns.

    Returns
    -------
    float
        1 on a standing flexspline. On a turning one :math:`1 + 1/N`: the gauges turn against the
        wave generator, so that it passes them oftener.
    """
    return 1.0 if drive.flexspline == "standing" else 1.0 + 1.0 / drive.gear_ratio
