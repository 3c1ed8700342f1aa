"""Columns that follow from others: torque from current, velocity from angle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdbench.errors import DataError, UsageError
from hdbench.records.trace import FloatArray

__all__ = ["Derived", "derived_columns"]

_ORDER = 4
# the derivative is filtered on an even grid; times that differ less from it are even enough
_EVEN_SHARE = 0.01


@dataclass(frozen=True, slots=True)
class Derived:
    """What is computed of other columns.

    Parameters
    ----------
    torque_constant_nm_per_a : float or None
        Torque per current, N m/A; None takes no torque from the current.
    velocity_from_angle_hz : float or None
        Cutoff of the low-pass behind the derivative of the angle, Hz; None takes none.
    """

    torque_constant_nm_per_a: float | None = None
    velocity_from_angle_hz: float | None = None


def derived_columns(
    columns: Mapping[str, FloatArray], derived: Derived, where: str
) -> tuple[dict[str, FloatArray], dict[str, list[str]]]:
    """Return the derived columns and what was done for each."""
    made: dict[str, FloatArray] = {}
    done: dict[str, list[str]] = {}
    constant = derived.torque_constant_nm_per_a
    if constant is not None:
        _check(columns, "motor_current_a", "torque_nm", "--torque-constant")
        made["torque_nm"] = columns["motor_current_a"] * constant
        done["torque_nm"] = [f"motor_current_a times {constant!r} N m/A"]
    cutoff = derived.velocity_from_angle_hz
    if cutoff is not None:
        _check(columns, "motor_angle_rad", "motor_velocity_rad_s", "--velocity-from-angle")
        velocity, told = zero_phase_velocity(
            columns["time_s"], columns["motor_angle_rad"], cutoff, where
        )
        made["motor_velocity_rad_s"], done["motor_velocity_rad_s"] = velocity, told
    return made, done


def _check(columns: Mapping[str, FloatArray], needed: str, made: str, option: str) -> None:
    if needed not in columns:
        fix = f"give --map {needed}=COLUMN"
        raise UsageError(f"no column {needed} to take {made} from", where=option, fix=fix)
    if made in columns:
        fix = f"leave {option} or the --map of {made} out"
        raise UsageError(f"{made} is mapped and derived", where=option, fix=fix)


def zero_phase_velocity(
    time: FloatArray, angle: FloatArray, cutoff_hz: float, where: str
) -> tuple[FloatArray, list[str]]:
    """Return the velocity of an angle without lag, and how it was made.

    Second-order central differences over the times as they are, then a Butterworth low-pass forward
    and backward. Uneven times are filtered on an even grid of the median step, by linear
    interpolation there and back. A lost angle gives a lost velocity.
    """
    from scipy.signal import butter, sosfiltfilt

    there = np.isfinite(angle)
    at, known = time[there], angle[there]
    # sosfiltfilt pads with three times the length of its sections on either side
    least = 3 * (_ORDER + 1) + 1
    if len(at) < least:
        what = f"{len(at)} samples of the angle; needed: {least} to take a velocity from"
        raise DataError(what, where=where, fix="record longer, or map a velocity")
    step = float(np.median(np.diff(at)))
    if not cutoff_hz < 0.5 / step:
        raise DataError(
            f"cutoff {cutoff_hz:g} Hz; needed: below half the sample rate, {0.5 / step:.6g} Hz",
            where=f"{where}, --velocity-from-angle",
            fix="give a lower cutoff",
        )
    raw = np.gradient(known, at)
    sections = butter(_ORDER, cutoff_hz, fs=1.0 / step, output="sos")
    even = float(np.max(np.abs(np.diff(at) / step - 1.0))) < _EVEN_SHARE
    told = [
        "derivative of motor_angle_rad: central differences over the times of the samples, then "
        f"Butterworth low-pass of order {_ORDER} at {cutoff_hz:g} Hz forward and backward "
        "(zero phase)"
    ]
    if even:
        smooth = sosfiltfilt(sections, raw)
    else:
        count = int(np.ceil((at[-1] - at[0]) / step)) + 1
        if count > 4 * len(at):
            what = f"gaps of the angle are {count / len(at):.0f} times as long as its samples"
            raise DataError(what, where=where, fix="import a part without gaps, or map a velocity")
        grid = at[0] + step * np.arange(count)
        smooth = np.interp(at, grid, sosfiltfilt(sections, np.interp(grid, at, raw)))
        told.append(f"filtered on an even grid of {step:.6g} s, for the times are uneven")
    velocity = np.full(len(time), np.nan)
    velocity[there] = smooth
    return velocity, told
