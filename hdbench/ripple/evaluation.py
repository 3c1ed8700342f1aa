"""Torque ripple of a free-motion run: orders, spectrum, suppression."""

from __future__ import annotations

import math

import numpy as np

from hdbench.errors import DataError, UsageError
from hdbench.filter import FilterModel, filter_trace
from hdbench.model import baseline_orders
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import TorqueScale
from hdbench.records.trace import Trace
from hdbench.ripple.record import Record, Stretch, prepare
from hdbench.ripple.regression import regress
from hdbench.ripple.result import RippleResult
from hdbench.ripple.summary import summarise

__all__ = ["evaluate_ripple"]

# below two cycles an offset and a sinusoid are hardly told apart
_LEAST_CYCLES = 2.0


def evaluate_ripple(
    trace: Trace,
    profile: ProfileData,
    *,
    scale: TorqueScale,
    filter_model: FilterModel,
    orders: tuple[float, ...] | None = None,
    stretch: Stretch | None = None,
) -> RippleResult:
    """Evaluate the torque ripple of a run.

    Parameters
    ----------
    trace : Trace
        Torque, velocity and, where there is one, an angle.
    profile : ProfileData
        Gear ratio, load inertia, tolerance of a steady stretch.
    scale : TorqueScale
        Gain with its uncertainty.
    filter_model : FilterModel
        Filter whose suppression is measured.
    orders : tuple of float, optional
        Motor orders, cycles per motor turn, above 0, all different; without it those of the
        model's baseline: 2, 4 and further ones of the profile, seen from a turning flexspline
        times 1 + 1/N.
    stretch : Stretch, optional
        Which samples; all without it.

    Returns
    -------
    RippleResult

    Raises
    ------
    DataError
        If a channel is missing, the motor turns less than two cycles of the lowest order, or too
        few samples are left to tell the orders apart.
    UsageError
        If an order is not a finite number above 0.

    Notes
    -----
    ``torque - J/N acceleration = slow terms + sum_o (a_o cos(o angle) + b_o sin(o angle)) +
    output order 1 (where the output spans a turn) and 2 (1.5 turns) + lines found + coloured
    noise`` by generalised least squares over all samples chosen. Slow terms are chosen by BIC,
    see `choose_trend`. Suppression is the ratio of the amplitudes that the same columns have in
    measured and in filtered torque. Where the angle was integrated from a velocity, a scale error
    of it of up to 1 % is found from the measured order of the strongest component, and the angle
    is corrected.

    References
    ----------
    .. [1] H. D. Taghirad, CIM-TR-97-06, McGill University, 1997, section 4.
    """
    orders = baseline_orders(profile) if orders is None else orders
    record = prepare(trace, profile, scale, stretch or Stretch())
    _check_travel(record, orders, stretch)
    filtered = filter_trace(
        trace.with_columns(torque_nm=record.torque_nm),
        filter_model,
        velocity_gain_rad_s_per_v=profile.tacho.gain_rad_s_per_v,
        encoder_counts_per_turn=profile.encoder.counts_per_turn,
    ).torque_filtered_nm
    try:
        regression = regress(record, orders, filtered)
    except ValueError as error:
        raise DataError(
            f"orders {', '.join(f'{o:g}' for o in orders)} cannot be fitted: {error}; "
            f"{int(record.used.sum())} samples were chosen",
            where=f"{trace.source}: {_described(stretch)}",
            fix="choose a longer stretch, or one at higher velocity",
        ) from error
    return summarise(record, regression, profile, scale, filter_model.name)


def _check_travel(record: Record, orders: tuple[float, ...], stretch: Stretch | None) -> None:
    """Raise where the motor turns less than two cycles of the lowest order."""
    if not (orders and all(0.0 < order < math.inf for order in orders)):
        raise UsageError(
            f"orders are {orders}; needed: one or more finite numbers above 0",
            where="orders",
            fix="name the motor orders to be fitted, such as 2 and 4",
        )
    cycles = float(np.ptp(record.motion.angle_rad[record.used])) / (2.0 * math.pi) * min(orders)
    if not cycles >= _LEAST_CYCLES:
        raise DataError(
            f"the motor turns {cycles:.3g} cycles of order {min(orders):g}; needed: at least "
            f"{_LEAST_CYCLES:g}",
            where=f"{record.trace.source}: {_described(stretch)}",
            fix="choose a longer stretch, or record the run with more motor turns",
        )


def _described(stretch: Stretch | None) -> str:
    return "all samples" if stretch is None else stretch.describe()
