"""One constant-velocity trace made ready for the regression, and the columns of its fit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import DataError
from hdbench.estimation.channel import stretch_starts, torque_channel
from hdbench.estimation.harmonics import TURNS_FOR_ORDER_2, harmonic_columns
from hdbench.estimation.stretches import SteadyStretch, steady_runs
from hdbench.model import baseline_orders
from hdbench.model.motion import Motion, motion_from_trace
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import TorqueScale
from hdbench.records.trace import FloatArray, Trace

__all__ = [
    "TURN_MARGIN",
    "Record",
    "cannot_fit",
    "design_columns",
    "prepare",
]

# turns are counted to 2 %: the steady stretch of a plan of whole turns misses its first samples
TURN_MARGIN = 0.02
# below one turn offset and sinusoid are hardly told apart
_LEAST_TURNS = 1.0
# a short stretch has an offset of its own and still tells of the ripple, but below a quarter turn
# its offset takes what it knows of the output order
_LEAST_STRETCH_TURNS = 0.25


@dataclass(frozen=True, slots=True)
class Record:
    """One trace made ready for the regression.

    Parameters
    ----------
    trace : Trace
        As measured.
    motion : Motion
        Its motion.
    torque_nm, expected_nm : ndarray, shape (n,)
        Measured torque and J/N times the acceleration without lag, N m.
    stretches : tuple of SteadyStretch
        Steady stretches that enter, in time order.
    turns : tuple of float
        Output turns of each.
    used : ndarray of bool, shape (n,)
        Samples that enter.
    starts : ndarray of bool, shape (n,)
        Where a stretch begins.
    ripple_orders : tuple of float
        Ripple orders of the model's baseline, fitted jointly.
    """

    trace: Trace
    motion: Motion
    torque_nm: FloatArray
    expected_nm: FloatArray
    stretches: tuple[SteadyStretch, ...]
    turns: tuple[float, ...]
    used: NDArray[np.bool_]
    starts: NDArray[np.bool_]
    ripple_orders: tuple[float, ...]


def cannot_fit(trace: Trace, what: str) -> DataError:
    """Return the error for a trace that no misalignment can be fitted to."""
    return DataError(
        what,
        where=f"{trace.source}: motor velocity",
        fix="record a run at constant velocity over at least two output turns",
    )


def prepare(trace: Trace, profile: ProfileData, scale: TorqueScale) -> Record:
    """Return torque, motion and steady stretches of a trace."""
    torque = torque_channel(trace, scale)
    motion = motion_from_trace(trace, profile)
    stretches, turns = _steady(trace, motion, profile)
    starts = stretch_starts(motion.time_s)
    used = np.zeros(len(torque), dtype=bool)
    for run in stretches:
        used[run.start : run.stop] = True
        starts[run.start] = True
    used &= motion.valid & np.isfinite(torque)
    expected = profile.drive.load_inertia_kg_m2 / motion.gear_ratio * motion.acceleration_rad_s2
    return Record(
        trace,
        motion,
        torque,
        expected,
        stretches,
        turns,
        used,
        starts,
        baseline_orders(profile),
    )


def _steady(
    trace: Trace, motion: Motion, profile: ProfileData
) -> tuple[tuple[SteadyStretch, ...], tuple[float, ...]]:
    """Return the stretches that enter and the output turns of each."""
    settle_s, tolerance = profile.misalignment.settle_s, profile.ripple.steady_tolerance
    runs = steady_runs(motion.time_s, motion.velocity_rad_s, settle_s=settle_s, tolerance=tolerance)
    if not runs:
        raise cannot_fit(
            trace,
            f"no stretch is steady: found none within {100.0 * tolerance:g} % of its median "
            f"velocity for longer than {settle_s:g} s",
        )
    turns = [_turns(motion, run) for run in runs]
    if not max(turns) >= _LEAST_TURNS - TURN_MARGIN:
        raise cannot_fit(
            trace,
            f"the longest steady stretch spans {max(turns):.3f} output turns "
            f"({max(turns) * motion.gear_ratio:.1f} motor turns); needed: at least 1 output turn "
            f"({motion.gear_ratio:g} motor turns), better 2",
        )
    kept = [i for i, n in enumerate(turns) if n >= _LEAST_STRETCH_TURNS]
    return tuple(runs[i] for i in kept), tuple(turns[i] for i in kept)


def _turns(motion: Motion, run: SteadyStretch) -> float:
    angle = motion.output_angle_rad[run.start : run.stop]
    return float(np.nanmax(angle) - np.nanmin(angle)) / (2.0 * math.pi)


def design_columns(record: Record) -> FloatArray:
    """Return offset per stretch, output order 1, orders 2 and 4, and output order 2, in this order.

    Notes
    -----
    Output order 2 (a shaft at an angle) lies so close to order 1 that no search would tell it from
    a drift; it is fitted wherever the record is long enough to hold both.
    """
    offsets = np.zeros((len(record.torque_nm), len(record.stretches)))
    for i, run in enumerate(record.stretches):
        offsets[run.start : run.stop, i] = 1.0
    columns = [
        offsets,
        harmonic_columns(record.motion.output_angle_rad, [1.0]),
        harmonic_columns(record.motion.angle_rad, record.ripple_orders),
    ]
    if max(record.turns) >= TURNS_FOR_ORDER_2:
        columns.append(harmonic_columns(record.motion.output_angle_rad, [2.0]))
    return np.hstack(columns)
