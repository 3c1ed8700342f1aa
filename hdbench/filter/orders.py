"""Orders over time: smoothed amplitude and phase of each, order spectrum and map."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hdbench.errors import DataError
from hdbench.estimation.spectrum import amplitude_spectrum, find_peaks
from hdbench.estimation.stretches import true_runs
from hdbench.filter.kalman import USABLE, pack, smooth
from hdbench.filter.model import FilterModel, OscillatorBlock
from hdbench.filter.online import Channels, faults_of
from hdbench.records import FloatArray
from hdbench.results.dynamic import SpectrumLine


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
    if not channels.usable.any():
        raise DataError(
            "no sample has torque and velocity",
            where=channels.source,
            fix="record the torque and velocity channels",
        )
    with faults_of(channels.source):
        samples = channels.samples if model.use_measured_angle else (*channels.samples[:3], None)
        found = smooth(pack(model), samples)
    angle = motor_angle(channels)
    elapsed = channels.time_s - channels.time_s[0]
    n = len(model.blocks)
    waves = tuple(
        _wave(block, found.mean[:, i], found.covariance[:, i], block.turned(angle, elapsed))
        for i, block in enumerate(model.blocks)
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
    block: OscillatorBlock, mean: FloatArray, covariance: FloatArray, turned: FloatArray
) -> OrderWave:
    hz = block.frequency_hz
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
        name=f"{hz:g}_hz" if hz > 0.0 else f"order_{block.order:g}",
        role=block.role,
        order=block.order,
        frequency_hz=hz,
        torque_nm=first,
        amplitude_nm=amplitude,
        amplitude_std_nm=np.sqrt(np.maximum(np.where(amplitude > 0.0, along, flat), 0.0)),
        phase_rad=math.pi - np.mod(math.pi - phase, 2.0 * math.pi),
        phase_std_rad=np.where(np.isnan(amplitude) | (amplitude > 0.0), phase_std, math.pi),
    )


_LEAST_TURNS = 4.0
_GAP_PERIODS = 2.5  # a step of time above this many median periods is a gap
_SLOWEST = 0.02  # of the fastest speed: below, the angle hardly moves and noise piles up
_MAP_WINDOWS = 24


@dataclass(frozen=True, slots=True)
class OrderSpectrum:
    """Amplitude over order of the longest stretch that turned one way without a gap."""

    order: FloatArray
    amplitude_nm: FloatArray
    peaks: tuple[SpectrumLine, ...]
    turns: float  # the resolution is one over it
    from_s: float
    to_s: float
    speed_rad_s: tuple[float, float, float]  # least, mean, largest


@dataclass(frozen=True, slots=True)
class OrderMap:
    """Order spectra along the same stretch."""

    time_s: FloatArray
    speed_rad_s: FloatArray
    order: FloatArray
    amplitude_nm: FloatArray
    turns: float


@dataclass(frozen=True, slots=True)
class _Stretch:
    """The torque over evenly spaced motor turns."""

    torque_nm: FloatArray
    time_s: FloatArray
    speed_rad_s: FloatArray
    turn_step: float
    highest_order: float


def order_spectrum(
    channels: Channels, torque_nm: FloatArray, *, highest_order: float = 12.0
) -> OrderSpectrum:
    """Return the order spectrum of a trace.

    Notes
    -----
    The torque is interpolated by a cubic spline to even steps of the motor angle. At most half
    the samples per turn at the fastest speed are orders.
    """
    stretch = _resampled(channels, torque_nm, highest_order)
    spectrum = amplitude_spectrum(stretch.torque_nm, stretch.turn_step)
    mean = float(np.mean(stretch.speed_rad_s))
    # with turns for seconds a frequency is an order; 2 pi rad/s is one turn per turn
    named = {f"{order:g}x": float(order) for order in (1, 2, 4)}
    peaks = tuple(
        replace(
            peak,
            frequency_hz=peak.order * mean / (2.0 * math.pi),
            angular_frequency_rad_s=peak.order * mean,
        )
        for peak in find_peaks(spectrum, 2.0 * math.pi, named)
        if peak.order <= stretch.highest_order
    )
    wanted = spectrum.frequency_hz <= stretch.highest_order
    speed = stretch.speed_rad_s
    return OrderSpectrum(
        spectrum.frequency_hz[wanted],
        spectrum.amplitude[wanted],
        peaks,
        stretch.turn_step * (stretch.torque_nm.size - 1),
        float(stretch.time_s[0]),
        float(stretch.time_s[-1]),
        (float(np.min(speed)), mean, float(np.max(speed))),
    )


def order_map(
    channels: Channels, torque_nm: FloatArray, *, highest_order: float = 12.0
) -> OrderMap:
    """Return order spectra of overlapping windows along a trace."""
    stretch = _resampled(channels, torque_nm, highest_order)
    n = stretch.torque_nm.size
    least = math.ceil(_LEAST_TURNS / stretch.turn_step)
    size = min(max(least, 2 * n // (_MAP_WINDOWS + 1), 16), n)
    rows, times, speeds = [], [], []
    order: FloatArray = np.empty(0)
    for start in range(0, n - size + 1, max(1, size // 2)):
        part = slice(start, start + size)
        spectrum = amplitude_spectrum(stretch.torque_nm[part], stretch.turn_step)
        wanted = np.flatnonzero(spectrum.frequency_hz <= stretch.highest_order)
        # the grid is padded at least fourfold: every second line still shows every peak
        order, row = spectrum.frequency_hz[wanted][::2], spectrum.amplitude[wanted][::2]
        rows.append(row)
        times.append(float(np.mean(stretch.time_s[part])))
        speeds.append(float(np.mean(stretch.speed_rad_s[part])))
    return OrderMap(
        np.array(times), np.array(speeds), order, np.array(rows), size * stretch.turn_step
    )


def _resampled(channels: Channels, torque_nm: FloatArray, highest_order: float) -> _Stretch:
    """Return the longest stretch over even steps of the motor angle."""
    from scipy.interpolate import CubicSpline

    angle = motor_angle(channels)
    first, after = _longest(channels, torque_nm, angle)
    time, torque = channels.time_s[first:after], torque_nm[first:after]
    turned = np.abs(angle[first:after] - angle[first]) / (2.0 * math.pi)
    speed = np.abs(channels.velocity_rad_s[first:after])
    per_sample = np.diff(turned)
    reach = 0.5 / float(np.max(per_sample))
    # the slower parts hold more samples per turn: keep them apart, so that noise does not fold
    step = float(np.quantile(per_sample, 0.05))
    step = max(step, float(np.max(per_sample)) * _SLOWEST)
    grid = np.arange(math.floor(float(turned[-1]) / step) + 1) * step
    return _Stretch(
        np.asarray(CubicSpline(turned, torque)(grid), dtype=np.float64),
        np.interp(grid, turned, time),
        np.interp(grid, turned, speed),
        step,
        min(highest_order, reach),
    )


def _longest(channels: Channels, torque_nm: FloatArray, angle: FloatArray) -> tuple[int, int]:
    """Return first and past-last sample of the stretch with the most turns."""
    time, velocity = channels.time_s, channels.velocity_rad_s
    known = (np.abs(velocity) <= USABLE) & (np.abs(torque_nm) <= USABLE)
    fastest = float(np.max(np.abs(velocity[known]), initial=0.0))
    sign = np.where(known & (np.abs(velocity) > _SLOWEST * fastest), np.sign(velocity), 0.0)
    dt = np.diff(time)
    turning = np.sign(np.diff(angle))
    together = (sign[1:] == sign[:-1]) & (sign[1:] != 0.0) & (turning == sign[1:])
    together &= dt <= _GAP_PERIODS * float(np.median(dt)) if dt.size else False
    best, most = (0, 0), 0.0
    for a, b in true_runs(together):
        turns = abs(float(angle[b] - angle[a])) / (2.0 * math.pi)
        if turns > most:
            best, most = (a, b + 1), turns
    if not most >= _LEAST_TURNS:
        raise DataError(
            f"the longest stretch that turns one way without a gap has {most:.3g} motor turns; "
            f"needed: {_LEAST_TURNS:g}",
            where=channels.source,
            fix="record a longer run in one direction",
        )
    return best
