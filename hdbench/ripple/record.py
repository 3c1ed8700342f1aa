"""Which samples of a trace a ripple evaluation uses, and their torques."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import DataError, UsageError
from hdbench.estimation.channel import stretch_starts, torque_channel
from hdbench.model.motion import Motion, motion_from_trace
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import TorqueScale
from hdbench.records.trace import FloatArray, Trace

__all__ = ["Record", "Stretch", "prepare"]


@dataclass(frozen=True, slots=True)
class Stretch:
    """Which samples are evaluated; all by default.

    Parameters
    ----------
    velocity_above_rad_s : float or None
        Only samples whose motor velocity exceeds this in magnitude, rad/s.
    from_s, to_s : float or None
        Only samples within these times, s.
    """

    velocity_above_rad_s: float | None = None
    from_s: float | None = None
    to_s: float | None = None

    def __post_init__(self) -> None:
        for name in ("velocity_above_rad_s", "from_s", "to_s"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise UsageError(
                    f"{name} is {value!r}; needed: a finite number",
                    where=name,
                    fix="name a number, or leave it out",
                )

    def describe(self) -> str:
        """Return the stretch in words."""
        words = []
        if self.velocity_above_rad_s is not None:
            words.append(f"motor faster than {self.velocity_above_rad_s:g} rad/s")
        if self.from_s is not None:
            words.append(f"from {self.from_s:g} s")
        if self.to_s is not None:
            words.append(f"to {self.to_s:g} s")
        return ", ".join(words) or "all samples"


@dataclass(frozen=True, slots=True)
class Record:
    """One trace made ready for the regression.

    Parameters
    ----------
    trace : Trace
        The trace.
    motion : Motion
        Its motion.
    torque_nm, expected_nm : ndarray, shape (n,)
        Measured and expected torque, N m.
    used : ndarray of bool, shape (n,)
        Samples that are evaluated.
    starts : ndarray of bool, shape (n,)
        Where a new stretch begins.
    """

    trace: Trace
    motion: Motion
    torque_nm: FloatArray
    expected_nm: FloatArray
    used: NDArray[np.bool_]
    starts: NDArray[np.bool_]


def prepare(trace: Trace, profile: ProfileData, scale: TorqueScale, stretch: Stretch) -> Record:
    """Return motion, torques and samples of a trace for the regression."""
    torque = torque_channel(trace, scale)
    motion = motion_from_trace(trace, profile)
    used = motion.valid & np.isfinite(torque)
    if stretch.velocity_above_rad_s is not None:
        used &= np.abs(motion.velocity_rad_s) > stretch.velocity_above_rad_s
    if stretch.from_s is not None:
        used &= motion.time_s >= stretch.from_s
    if stretch.to_s is not None:
        used &= motion.time_s <= stretch.to_s
    if not used.any():
        raise DataError(
            "no sample is left to evaluate",
            where=f"{trace.source}: {stretch.describe()}",
            fix="choose a wider range of time or a lower velocity",
        )
    expected = profile.drive.load_inertia_kg_m2 / motion.gear_ratio * motion.acceleration_rad_s2
    return Record(trace, motion, torque, expected, used, stretch_starts(motion.time_s))
