"""Scans over motor order, output order and frequency, planned for one motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.detect.transform import PhaseTransform, plan_transform
from hdbench.diagnosis.measured.record import Record
from hdbench.records.trace import FloatArray

__all__ = ["OVERSAMPLE", "LineScan", "plan_scans"]

# grid points per resolution cell: the best grid point loses at most 2 % of the statistic
OVERSAMPLE = 4
# fewest resolution cells that make a scan worth while
_MIN_CELLS = 4.0
# the contract's baseline and the catalogue live below this order; a scan reaches at least here
_ORDER_REACH = 12.0
_MAX_ORDER = 60.0
_MAX_OUTPUT_ORDER = 20.0
# an angle this close to a straight line in time, turns, tells no order from its alias: the two
# differ by the sum of both orders, about ten, times this
_STRAIGHT = 0.1
# motor orders below this are output orders
_LOW_ORDER = 0.25
# share of valid samples from which time runs in even steps
_EVEN = 0.98
# speeds below this share of the largest are rest, for the normalisation only
_REST = 0.02


@dataclass(frozen=True, slots=True)
class LineScan:
    """A scan over one axis, planned for one motion.

    Parameters
    ----------
    domain : str
        ``motor-order``, ``output-order`` or ``frequency``.
    unit : str
        Unit of the axis.
    positions : ndarray, shape (n,)
        Turns or seconds; zero where not valid.
    rate : ndarray, shape (n,)
        Their change per sample.
    span : float
        Span of the positions: lines closer than 1/span are one.
    single : PhaseTransform
        Sums at f.
    doubled : tuple of (float, ndarray)
        Of the samples at rest, turning forwards and backwards: mean rate, and sums at 2 f.
    """

    domain: str
    unit: str
    positions: FloatArray
    rate: FloatArray
    span: float
    single: PhaseTransform
    doubled: tuple[tuple[float, NDArray[np.complex64]], ...]


def plan_scans(record: Record) -> tuple[LineScan, ...]:
    """Return the scans that a motion allows.

    Parameters
    ----------
    record : Record
        Record.

    Returns
    -------
    tuple of LineScan
        Motor order from 0.25 to the Nyquist equivalent at the median speed (60 at most, and 12 at
        least unless the speed is constant: then an order above it looks like one below), output
        order from 0.5 to 20, frequency from 2 cycles in the record to Nyquist; without those
        whose axis spans too little.
    """
    motion, valid = record.motion, record.valid
    turns = motion.angle_rad / (2.0 * np.pi)
    speed = np.abs(motion.velocity_rad_s[valid])
    moving = speed[speed > _REST * float(speed.max(initial=0.0))]
    per_sample = float(np.median(moving)) * record.period_s / (2.0 * np.pi) if len(moving) else 1.0
    least = 0.0 if _straight(motion.time_s[valid], turns[valid]) else _ORDER_REACH
    high = float(np.clip(0.5 / max(per_sample, 1e-9), least, _MAX_ORDER))
    output_high = max(_MAX_OUTPUT_ORDER, _LOW_ORDER * motion.gear_ratio)
    duration = float(np.ptp(motion.time_s[valid]))
    wanted = (
        ("motor-order", "1", turns, _LOW_ORDER, high),
        ("output-order", "1", motion.output_angle_rad / (2.0 * np.pi), 0.5, output_high),
        ("frequency", "Hz", motion.time_s, 2.0 / duration, 0.5 / record.period_s),
    )
    scans = []
    for domain, unit, axis, low, top in wanted:
        filled = np.where(valid, axis, axis[valid][0])
        span = float(np.ptp(filled))
        if not span * (top - low) >= _MIN_CELLS:
            continue
        step = 1.0 / (OVERSAMPLE * span)
        rate = np.where(valid, np.gradient(filled), 0.0)
        # sums at 2 f over even steps vanish but for the ends of the axis
        even = domain == "frequency" and float(valid.mean()) > _EVEN
        twice = () if even else _doubled(plan_transform(filled, step, low, top, 2.0), rate, valid)
        scans.append(
            LineScan(
                domain,
                unit,
                filled,
                rate,
                span,
                plan_transform(filled, step, low, top),
                twice,
            )
        )
    return tuple(scans)


def _doubled(
    transform: PhaseTransform, rate: FloatArray, valid: NDArray[np.bool_]
) -> tuple[tuple[float, NDArray[np.complex64]], ...]:
    """Return mean rate and sums at 2 f of what rests, turns forwards and turns backwards."""
    slow = float(np.abs(rate[valid]).max()) * _REST
    parts = []
    for group in (np.abs(rate) <= slow, rate > slow, rate < -slow):
        chosen = group & valid
        if chosen.any():
            parts.append((float(rate[chosen].mean()), transform(chosen.astype(float))))
    return tuple(parts)


def _straight(time_s: FloatArray, turns: FloatArray) -> bool:
    """Return whether the angle hardly leaves a straight line in time."""
    time = time_s - time_s.mean()
    away = turns - turns.mean()
    away = away - time * float(time @ away) / float(time @ time)
    return float(np.sqrt(np.mean(away**2))) < _STRAIGHT
