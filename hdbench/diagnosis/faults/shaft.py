"""Angle and velocity of one shaft: increments by both, and whether one was made of the other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import (
    binary_dilation,
    binary_opening,
    maximum_filter1d,
    minimum_filter1d,
    uniform_filter1d,
)

from hdbench.diagnosis.faults.scatter import (
    FAST,
    bridged,
    least_squares,
    mask_runs,
    robust_std,
    smallest_step,
)
from hdbench.diagnosis.faults.stamps import gap_steps
from hdbench.model import integrate_velocity
from hdbench.profile.scaling import angle_channel, velocity_channel
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

ANGLES = ("motor_angle_rad", "encoder_count")
VELOCITIES = ("motor_velocity_rad_s", "tacho_v")
# a shaft stands, or creeps until it breaks away, where it moves over so many samples by less than
# this share of what it usually does: no law of the speed holds there
_STILL, _STILL_SHARE = 20, 5e-3
# share of the torque's scatter by which it changes at standstill where dry friction holds it: drift
# and creep are smaller
_HOLDS = 0.1
# what stands out of the noise by this much is left out of a fit
_TRIM = 5.0
# share of what is fast in a velocity that scatters from sample to sample where it is noise: .21
# behind a filter of second order with its corner at a fifth of the Nyquist frequency, and .15 where
# it is much lower
_SCATTERS = 0.2


@dataclass(frozen=True, slots=True)
class Shaft:
    """Motor angle and velocity side by side."""

    time_s: FloatArray
    # between the samples: those of the stamps, or even ones where the shaft says that the sampling
    # was even and the stamps were not
    steps_s: FloatArray
    angle_rad: FloatArray
    velocity_rad_s: FloatArray
    moves_rad: FloatArray  # n - 1 increments of the angle
    good: NDArray[np.bool_]  # increments between present neighbours without a gap
    count_rad: float  # smallest step of the angle
    names: tuple[str, str]  # of angle and velocity

    @property
    def period_s(self) -> float:
        """Median sampling period, s."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def pace_rad_s(self) -> FloatArray:
        """Mean velocity between neighbouring samples, rad/s."""
        return np.asarray(0.5 * (self.velocity_rad_s[1:] + self.velocity_rad_s[:-1]))


def velocity_of(trace: Trace, profile: ProfileData) -> FloatArray | None:
    """Return the measured motor velocity, rad/s; None where there is none."""
    return velocity_channel(trace, profile) if any(n in trace for n in VELOCITIES) else None


def shaft_of(trace: Trace, profile: ProfileData) -> Shaft | None:
    """Return angle and velocity side by side; None where one is missing."""
    angle, velocity = angle_channel(trace, profile), velocity_of(trace, profile)
    if angle is None or velocity is None:
        return None
    moves, steps = np.diff(angle), np.diff(trace.time_s)
    pace = 0.5 * (velocity[1:] + velocity[:-1])
    good = np.isfinite(moves) & np.isfinite(pace)
    good[gap_steps(trace.time_s)] = False
    even = np.where(good, float(np.median(steps)), steps)
    off = [float(np.sum(np.abs(moves - pace * one)[good])) for one in (steps, even)]
    # even steps have to fit much better than the stamps
    steps = even if off[1] < 0.8 * off[0] else steps
    angle_name, velocity_name = (
        next(name for name in some if name in trace) for some in (ANGLES, VELOCITIES)
    )
    return Shaft(
        trace.time_s, steps, angle, velocity, moves, good, smallest_step(moves),
        (angle_name, velocity_name),
    )  # fmt: skip


def scaled(trace: Trace, names: tuple[str, ...], factor: FloatArray | float) -> Trace:
    """Return the trace with those of the named channels that it has times a factor."""
    columns = {name: np.asarray(trace[name] * factor) for name in names if name in trace}
    return trace.with_columns(**columns)


def without_faults(
    trace: Trace, profile: ProfileData, faults: Iterable[tuple[str, Mapping[str, float]]]
) -> Trace:
    """Return the trace without faults, each a name of the catalogue and its shape."""
    timed = []
    angle = angle_channel(trace, profile)
    for name, shape in faults:
        if name == "tacho-ripple" and angle is not None:
            turned = shape["order"] * np.nan_to_num(angle)
            ripple = shape["cosine"] * np.cos(turned) + shape["sine"] * np.sin(turned)
            trace = scaled(trace, VELOCITIES, 1.0 / (1.0 + ripple))
        elif name in ("encoder-slip", "missed-samples"):
            timed.append((shape["step_time_s"], shape))
    # the last ones first: a loss moves the stamps of all samples after it
    for place, shape in sorted(timed, key=lambda one: -one[0]):
        later = trace.time_s > place
        columns = {"time_s": trace.time_s + later * shape.get("missed_s", 0.0)}
        counts = profile.encoder.counts_per_turn / (2.0 * np.pi)
        for name, scale in zip(ANGLES, (1.0, counts), strict=True):
            if name in trace and "slip_rad" in shape:
                columns[name] = trace[name] - later * (shape["slip_rad"] * scale)
        trace = trace.with_columns(**columns)
    return trace


def standing(trace: Trace, profile: ProfileData, torque_nm: FloatArray) -> NDArray[np.bool_]:
    """Return samples at standstill, where the torque moves though the shaft does not.

    Dry friction holds any torque there, up to the one at which the shaft breaks away. Where the
    load is known, so is the torque at rest.
    """
    angle = angle_channel(trace, profile)
    if angle is None:
        velocity = velocity_of(trace, profile)
        angle = None if velocity is None else integrate_velocity(trace.time_s, velocity)[0]
    nothing = np.zeros(len(trace), dtype=bool)
    if angle is None or "load_torque_nm" in trace or len(angle) < 2 * _STILL:
        return nothing
    angle, torque = bridged(angle), bridged(torque_nm)
    moves = np.asarray(maximum_filter1d(angle, _STILL) - minimum_filter1d(angle, _STILL))
    # every sample of a window that stands, from its middle to its ends
    still = moves < _STILL_SHARE * float(np.quantile(moves, 0.9))
    still = binary_opening(still, np.ones(_STILL, dtype=bool))
    still = binary_dilation(still, iterations=_STILL // 2)
    mean = uniform_filter1d(torque, _STILL)
    inside = [mean[a : b + 1] - mean[a : b + 1].mean() for a, b in mask_runs(still)]
    alone = bool(inside) and float(np.std(np.concatenate(inside))) < _HOLDS * float(np.std(torque))
    return nothing if not inside or alone else still


def disagreement(shaft: Shaft) -> FloatArray:
    """Return increments of the angle that gain, offset and lag of the velocity leave, rad."""
    good, wanted, steps = shaft.good, shaft.moves_rad, shaft.steps_s
    left = np.zeros(len(good))
    velocity = bridged(shaft.velocity_rad_s)
    design = np.column_stack([bridged(shaft.pace_rad_s) * steps, np.diff(velocity), steps])
    off = np.abs(wanted - shaft.pace_rad_s * steps)
    # no jump touches 19 of 20 increments
    used = good & (off <= _TRIM * float(np.quantile(off[good], 0.95)))
    for _ in range(3):
        solution = least_squares(design[used], wanted[used])
        left[good] = wanted[good] - design[good] @ solution
        limit = max(_TRIM * robust_std(left[good]), 2.0 * shaft.count_rad)
        used = good & (np.abs(left) <= limit)
    return left


def _explained(wanted: FloatArray, source: FloatArray, good: NDArray[np.bool_], lags: int) -> float:
    """Return the share of the fast part of `wanted` that a free filter of `source` explains."""
    spans = np.concatenate([[0.0], np.cumsum(np.abs(source))])
    size = min(16384, len(source))
    if size < 8 * (lags + 2):
        return 0.0
    # the busiest stretch decides; the filter takes samples before each and one after it
    first = int(np.argmax(spans[size:] - spans[:-size]))
    part = slice(first, first + size)
    fast = [one - uniform_filter1d(one, FAST) for one in (wanted[part], source[part])]
    columns = np.lib.stride_tricks.sliding_window_view(fast[1], lags + 2)
    response = fast[0][lags:-1]
    whole = ~binary_dilation(~good[part], iterations=FAST)[lags:-1]
    # a few samples that stand out decide nothing
    kept = whole & (np.abs(response) <= _TRIM * max(robust_std(response), 1e-300))
    response, columns = response[kept], columns[kept]
    power = float(response @ response)
    if not power > 0.0 or len(response) < 4 * (lags + 2):
        return 0.0
    left = response - columns @ least_squares(columns, response)
    return 1.0 - float(left @ left) / power


def has_own_noise(shaft: Shaft) -> bool:
    """Return whether the velocity shows noise above its rounding: a sensor of its own.

    One that was smoothed bends, but does not scatter from sample to sample: where the motion
    changes, it parts from the angle for longer than a jump is looked at.
    """
    velocity = bridged(shaft.velocity_rad_s)
    fast = robust_std(velocity - uniform_filter1d(velocity, FAST))
    # of white noise the fourth difference has 1 + 16 + 36 + 16 + 1 times the variance
    scatter = robust_std(np.diff(velocity, 4)) / float(np.sqrt(70.0))
    rounding = smallest_step(shaft.velocity_rad_s) / float(np.sqrt(12.0))
    return fast > 2.0 * rounding and scatter > _SCATTERS * fast


def derivation(shaft: Shaft) -> tuple[str, str] | None:
    """Return (channel, channel that it was made of), or None for two sensors."""
    # what is fast in a channel is its own noise and rounding: where the other explains it, both
    # come from one sensor. An integrated angle holds nothing but the velocity; a filter of the
    # angle reaches over 60 samples. Of noise of its own another channel explains next to nothing
    steps, good, velocity = shaft.steps_s, shaft.good, bridged(shaft.velocity_rad_s)
    moves = bridged(np.where(good, shaft.moves_rad, np.nan))
    angle, tacho = shaft.names
    if _explained(moves, velocity[1:] * steps, good, 1) > 0.99:
        return angle, tacho
    if _explained(velocity[1:], moves / steps, good, 60) > 0.5:
        return tacho, angle
    return None
