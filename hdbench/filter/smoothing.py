"""Amplitude and phase of every block over time, from the whole trace (order tracking)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.errors import DataError
from hdbench.filter.kalman import USABLE, pack, smooth
from hdbench.filter.model import FilterModel
from hdbench.filter.traces import Channels
from hdbench.records import FloatArray


@dataclass(frozen=True, slots=True)
class OrderWave:
    """One oscillator over time; arrays of shape (n,), NaN before the filter has started."""

    name: str
    role: str
    order: float
    frequency_hz: float
    torque_nm: FloatArray
    amplitude_nm: FloatArray
    amplitude_std_nm: FloatArray
    phase_rad: FloatArray
    phase_std_rad: FloatArray


@dataclass(frozen=True, slots=True)
class SmoothedTorque:
    """A trace seen from all of its samples; arrays of shape (n,), N m."""

    torque_smoothed_nm: FloatArray
    slow_nm: FloatArray
    slow_std_nm: FloatArray  # as if slow blocks were independent: an upper bound
    waves: tuple[OrderWave, ...]


def motor_angle(channels: Channels) -> FloatArray:
    """Return the motor angle by which phases are stated."""
    time, velocity = channels.time_s, channels.velocity_rad_s
    known = np.abs(velocity) <= USABLE
    last = np.maximum.accumulate(np.where(known, np.arange(time.size), -1))
    held = np.where(last >= 0, velocity[np.maximum(last, 0)], 0.0)
    turned = np.concatenate(([0.0], np.cumsum(held[:-1] * np.diff(time))))[: time.size]
    if channels.angle_rad is None:
        return turned
    measured = np.abs(channels.angle_rad) <= USABLE
    if not measured.any():
        return turned
    at = np.maximum.accumulate(np.where(measured, np.arange(time.size), -1))
    first = int(np.argmax(measured))
    at = np.where(at >= 0, at, first)
    carried: FloatArray = channels.angle_rad[at] + (turned - turned[at])
    return carried


def smooth_channels(model: FilterModel, channels: Channels) -> SmoothedTorque:
    r"""Smooth a trace: every order's amplitude and phase over time.

    Notes
    -----
    Fixed-interval smoothing of the filter's own model, which is Vold-Kalman order tracking with
    process noise in place of a bandwidth [1]_. With the smoothed states
    :math:`x_1 = A\cos\psi, x_2 = -A\sin\psi`: amplitude :math:`\sqrt{x_1^2 + x_2^2}`, phase
    :math:`\operatorname{atan2}(-x_2, x_1)` less the order's angle, bands to first order.

    References
    ----------
    .. [1] H. Vold, J. Leuridan, "High resolution order tracking at extreme slew rates, using
       Kalman tracking filters", SAE 931288 (1993).
    """
    known = np.abs(channels.velocity_rad_s) <= USABLE
    if not (known & (np.abs(channels.torque_nm) <= USABLE)).any():
        raise DataError(
            "no sample has torque and velocity",
            where=channels.source,
            fix="record the torque and velocity channels",
        )
    try:
        found = smooth(
            pack(model),
            channels.time_s,
            channels.velocity_rad_s,
            channels.torque_nm,
            angle_rad=channels.angle_rad if model.use_measured_angle else None,
        )
    except DataError as error:
        where = f"{channels.source}: {error.where}"
        raise DataError(error.what, where=where, fix=error.fix) from error
    if found.covariance is None:
        raise ValueError("the smoother gave no covariance")
    angle = motor_angle(channels)
    elapsed = channels.time_s - channels.time_s[0]
    n = len(model.blocks)
    waves = tuple(
        _wave(model, i, found.mean[:, i], found.covariance[:, i], angle, elapsed=elapsed)
        for i in range(n)
    )
    taken = found.mean[:, :n, 0].sum(axis=1)
    slow_variance = np.maximum(found.covariance[:, n:, 0], 0.0).sum(axis=1)
    return SmoothedTorque(
        torque_smoothed_nm=channels.torque_nm - taken,
        slow_nm=found.mean[:, n:, 0].sum(axis=1),
        slow_std_nm=np.sqrt(slow_variance),
        waves=waves,
    )


def _wave(
    model: FilterModel,
    index: int,
    mean: FloatArray,
    covariance: FloatArray,
    angle: FloatArray,
    *,
    elapsed: FloatArray,
) -> OrderWave:
    block = model.blocks[index]
    if block.frequency_hz > 0.0:
        name, turned = f"{block.frequency_hz:g}_hz", 2.0 * math.pi * block.frequency_hz * elapsed
    else:
        name, turned = f"order_{block.order:g}", block.order * angle
    first, second = mean[:, 0], mean[:, 1]
    amplitude = np.hypot(first, second)
    p11, p12, p22 = covariance.T
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (first**2 * p11 + 2.0 * first * second * p12 + second**2 * p22) / amplitude**2
        across = (second**2 * p11 - 2.0 * first * second * p12 + first**2 * p22) / amplitude**2
        phase_std = np.minimum(np.sqrt(np.maximum(across, 0.0)) / amplitude, math.pi)
    flat = 0.5 * (p11 + p22)  # of no amplitude, in any direction
    phase = np.arctan2(-second, first) - turned
    return OrderWave(
        name=name,
        role=block.role,
        order=block.order,
        frequency_hz=block.frequency_hz,
        torque_nm=first,
        amplitude_nm=amplitude,
        amplitude_std_nm=np.sqrt(np.maximum(np.where(amplitude > 0.0, along, flat), 0.0)),
        phase_rad=math.pi - np.mod(math.pi - phase, 2.0 * math.pi),
        phase_std_rad=np.where(np.isnan(amplitude) | (amplitude > 0.0), phase_std, math.pi),
    )
