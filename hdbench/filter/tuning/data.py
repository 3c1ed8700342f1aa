"""Traces of a tuning: their samples, motion and noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdbench.errors import DataError
from hdbench.filter.kalman import USABLE
from hdbench.filter.traces import Channels

_LEAST_SAMPLES = 2000

OUTPUT_ORDER = 0.5
"""Orders below belong to the output: what takes them turns at a frequency below a torque's."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion of all traces together, and the variance of their torque."""

    samples: int
    duration_s: float
    period_s: float
    turned_rad: float
    speed_rad_s: float  # mean of its size while it turned
    slowest_rad_s: float  # 5 % and 95 % points of that size
    fastest_rad_s: float
    speed_spread: float
    torque_variance_nm2: float


def check_records(records: Sequence[Channels]) -> None:
    """Refuse traces that no noise can be estimated from."""
    if not records:
        raise DataError("found no trace", where="tune", fix="name at least one trace or run")
    for record in records:
        n = int(np.count_nonzero(_usable(record)))
        if n < _LEAST_SAMPLES:
            raise DataError(
                f"{n} of {len(record.torque_nm)} samples have torque and velocity, neither missing "
                f"nor saturated; needed: at least {_LEAST_SAMPLES}",
                where=record.source,
                fix="give a longer trace, or one whose channels are in range",
            )


def _usable(record: Channels) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return (np.abs(record.torque_nm) <= USABLE) & (np.abs(record.velocity_rad_s) <= USABLE)


def describe_motion(records: Sequence[Channels]) -> Motion:
    """Return what the traces' motion can tell."""
    samples, duration, turned, periods = 0, 0.0, 0.0, []
    speeds, torques = [], []
    for record in records:
        usable = _usable(record)
        samples += int(np.count_nonzero(usable))
        steps = np.diff(record.time_s)
        duration += float(record.time_s[-1] - record.time_s[0])
        periods.append(float(np.median(steps)))
        speed = np.abs(np.where(np.abs(record.velocity_rad_s) <= USABLE, record.velocity_rad_s, 0))
        turned += float(np.sum(speed[:-1] * steps))
        speeds.append(speed[usable])
        torque = record.torque_nm[usable]
        torques.append(torque - np.mean(torque))
    speed = np.concatenate(speeds)
    # a hundredth of the fastest is standstill, tacho noise included
    moving = speed[speed > 0.01 * float(np.max(speed))]
    mean = float(np.mean(moving)) if moving.size else 0.0
    return Motion(
        samples=samples,
        duration_s=duration,
        period_s=float(np.median(periods)),
        turned_rad=turned,
        speed_rad_s=mean,
        slowest_rad_s=float(np.quantile(moving, 0.05)) if moving.size else 0.0,
        fastest_rad_s=float(np.quantile(moving, 0.95)) if moving.size else 0.0,
        speed_spread=float(np.std(moving)) / mean if mean > 0.0 else 0.0,
        torque_variance_nm2=float(np.mean(np.square(np.concatenate(torques)))),
    )


def noise_guess_nm2(records: Sequence[Channels]) -> float:
    """Return a first guess of the measurement noise, from third differences of the torque."""
    guesses = []
    for record in records:
        third = np.diff(record.torque_nm, 3)
        third = third[np.isfinite(third)]
        if third.size:
            # the median of squares of a normal variable is 0.4549 of its variance
            guesses.append(float(np.median(np.square(third))) / (0.4549 * 20.0))
    guess = float(np.median(guesses)) if guesses else 0.0
    if not 0.0 < guess < math.inf:
        raise DataError(
            "the torque has no noise: most third differences are 0 or missing",
            where=", ".join(record.source for record in records),
            fix="give the torque as it was sampled, neither held nor rounded to few steps",
        )
    return guess


_STUCK = 20  # equal samples in a row; with noise of a step or more chance gives them in 1e8 s


def stuck_after(records: Sequence[Channels], noise_nm2: float) -> int | None:
    """Return from how many equal samples in a row on a converter is stuck."""
    steps = np.concatenate([np.abs(np.diff(record.torque_nm)) for record in records])
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    if not steps.size or not math.sqrt(noise_nm2) >= float(np.min(steps)):
        return None
    return _STUCK


_PREVIEW_SAMPLES = 12_000  # a dozen seconds at 1 kHz: an output turn, and slow torque at 0.3 Hz


def preview(record: Channels) -> Channels:
    """Return a middle part of a trace, enough to come near the most likely point."""
    n = record.time_s.size
    if n <= _PREVIEW_SAMPLES:
        return record
    first = (n - _PREVIEW_SAMPLES) // 2
    part = slice(first, first + _PREVIEW_SAMPLES)
    return replace(
        record,
        time_s=record.time_s[part],
        velocity_rad_s=record.velocity_rad_s[part],
        torque_nm=record.torque_nm[part],
        angle_rad=None if record.angle_rad is None else record.angle_rad[part],
    )
