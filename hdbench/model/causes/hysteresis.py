"""Hysteresis of the sensor: a loop over the torque that does not depend on its rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hdbench.model.causes._memory import plays, remembered, spread_out
from hdbench.model.causes._needs import all_of, loaded, torque_turns
from hdbench.model.causes._parts import ratio_parameter, torque_parameter
from hdbench.model.definition import Cause, Parameter
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["HYSTERESIS"]

# elements whose yields lie evenly between 0 and the largest: the curve of first loading is within
# 1/(8 n^2) = 0.2 % of the parabola of infinitely many
_ELEMENTS = 8
# where the angle of static readings comes from, as `motion_from_loads` says
_READINGS = "position_rad"


def _loop(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    applied = motion.applied_nm
    at, starts = remembered(motion, applied)
    torque = applied[at]
    yields = shape["yield_nm"] * (np.arange(_ELEMENTS) + 0.5) / _ELEMENTS
    loop = (_ELEMENTS * torque - plays(torque, yields, starts)) / yields.sum()
    # the gain of a calibration is fitted with all loops of the sensor in it; its readings need none
    gain = np.zeros(len(motion)) if motion.angle_source == _READINGS else applied
    return np.column_stack((spread_out(loop, at, len(motion)), gain))


def _reach(motion: Motion) -> dict[str, tuple[float, float]]:
    torque = motion.applied_nm[motion.valid & np.isfinite(motion.applied_nm)]
    span = float(np.ptp(torque)) if len(torque) else 0.0
    # elements beyond half the span never yield: from there on the loop keeps its form, a parabola
    return {"yield_nm": (0.01 * span, 0.5 * span)}


def _possible(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    """Return the loop with all that a gain leaves of it, and without any.

    A gain that was calibrated with the loop holds a part of its slope: between nothing and the
    chord of its first loading up to the largest torque. More, or of the other sign, is an error of
    the gain.
    """
    torque = motion.applied_nm[motion.valid & np.isfinite(motion.applied_nm)]
    largest = max(float(np.abs(torque).max(initial=0.0)), np.finfo(float).tiny)
    yields = shape["yield_nm"] * (np.arange(_ELEMENTS) + 0.5) / _ELEMENTS
    chord = float(np.minimum(yields, largest).sum() / yields.sum()) / largest
    return np.array([[1.0, 1.0], [0.0, -chord]])


HYSTERESIS = Cause(
    name="hysteresis",
    equation="h (sum of 8 elastic elements in tau that slip at (k - 1/2) Y / 8) / (4 Y) + g tau",
    shape=(Parameter("yield_nm", "N m", 0.005, 500.0, "torque at which the last one slips, Y"),),
    linear=(
        torque_parameter("loop_nm", "half of the loop's width far above the yield torque, h"),
        # alone it is a gain error: only the loop speaks for a loop
        replace(
            ratio_parameter("gain", "minus the elastic part that the calibrated gain holds, g"),
            evident=False,
        ),
    ),
    locked_to="load",
    parity="odd in the direction in which the torque changes; the same at any rate",
    channel="sensor",
    look_alikes=("coulomb-friction", "backlash", "creep", "time-skew"),
    experiment="locked triangle of torque at three amplitudes and two rates",
    source="W. D. Iwan 1966, J. Appl. Mech. 33:893 (elements that slip, in parallel)",
    columns=_loop,
    harmonic=False,
    applicable=all_of(loaded, torque_turns),
    reach=_reach,
    possible=_possible,
)
