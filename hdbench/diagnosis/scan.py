"""Continuous scans of the residual over motor order, output order and frequency."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.record import Record
from hdbench.diagnosis.transform import PhaseTransform, plan_transform
from hdbench.diagnosis.whitened import Space
from hdbench.records.trace import FloatArray

__all__ = ["OVERSAMPLE", "LineScan", "ScanResult", "plan_scans", "scan_line", "upcrossing_rate"]

# grid points per resolution cell: the best grid point loses at most 2 % of the statistic
OVERSAMPLE = 4
# share of a column that must be left after the baseline was projected out
_MIN_SHARE = 0.05
# level of the upcrossing count: low enough for hundreds of crossings in one draw
_LEVEL = 6.0
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
    single, double : PhaseTransform
        Sums at f and at 2 f.
    """

    domain: str
    unit: str
    positions: FloatArray
    rate: FloatArray
    span: float
    single: PhaseTransform
    double: PhaseTransform


@dataclass(frozen=True, slots=True)
class ScanResult:
    """Statistic of a scan.

    Parameters
    ----------
    grid : ndarray, shape (n_grid,)
        Orders, or Hz.
    statistic : ndarray, shape (n_grid,)
        chi^2 with two degrees of freedom without a line; 0 where it cannot be formed.
    amplitude : ndarray, shape (n_grid,)
        Amplitude of the best line, N m.
    sigma : ndarray, shape (n_grid,)
        Standard deviation of each quadrature, N m; infinite where it cannot be formed.
    usable : ndarray of bool, shape (n_grid,)
        Where it could be formed.
    rate : float
        W of `upcrossing_rate`, by white noise through the same scan.
    """

    grid: FloatArray
    statistic: FloatArray
    amplitude: FloatArray
    sigma: FloatArray
    usable: NDArray[np.bool_]
    rate: float


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
        rate = np.gradient(filled)
        scans.append(
            LineScan(
                domain,
                unit,
                filled,
                np.where(valid, rate, 0.0),
                span,
                plan_transform(filled, step, low, top),
                plan_transform(filled, step, low, top, 2.0),
            )
        )
    return tuple(scans)


def _straight(time_s: FloatArray, turns: FloatArray) -> bool:
    """Return whether the angle hardly leaves a straight line in time."""
    time = time_s - time_s.mean()
    away = turns - turns.mean()
    away = away - time * float(time @ away) / float(time @ time)
    return float(np.sqrt(np.mean(away**2))) < _STRAIGHT


def _response(space: Space, cycles: FloatArray) -> NDArray[np.complex128]:
    """Return the whitener's response at any cycles per sample, from a fine table."""
    table = np.linspace(0.0, 0.5, 2049)
    gain = space.whitener.power_gain(table)
    folded = cycles - np.round(cycles)
    size = np.abs(folded)
    value = np.interp(size, table, gain.real) + 1j * np.interp(size, table, gain.imag)
    return np.where(folded < 0.0, value.conj(), value)


def _norms(space: Space, scan: LineScan) -> tuple[FloatArray, NDArray[np.complex128]]:
    """Return sum |F|^2 and sum F^2 of the whitened line exp(-i phase) at each grid point.

    The whitener acts on a line of slowly changing rate as its frequency response there; rates
    are gathered in classes, which moves the sums by less than the classes are wide.
    """
    used = space.whitener.used
    rate, grid = scan.rate, scan.single.grid
    magnitude = np.abs(rate[used])
    counts, edges = np.histogram(magnitude, bins=32, range=(0.0, float(magnitude.max()) + 1e-300))
    sums, _ = np.histogram(magnitude, bins=edges, weights=magnitude)
    total = np.zeros(len(grid))
    for count, weight in zip(counts, sums, strict=True):
        if count:
            total += count * np.abs(_response(space, grid * (weight / count))) ** 2
    slow = magnitude.max() * _REST
    doubled = np.zeros(len(grid), dtype=np.complex128)
    for group in (np.abs(rate) <= slow, rate > slow, rate < -slow):
        chosen = group & used
        if chosen.any():
            mean = float(rate[chosen].mean())
            gain = _response(space, -grid * mean) ** 2
            doubled += gain * scan.double(chosen.astype(float)[:, None])[0]
    return total, doubled


def scan_line(space: Space, scan: LineScan, null_pulls: FloatArray) -> ScanResult:
    """Return the statistic of a line at every grid point.

    Parameters
    ----------
    space : Space
        Whitened residual.
    scan : LineScan
        Scan.
    null_pulls : ndarray, shape (n, draws)
        As `Space.null_pulls`.

    Returns
    -------
    ScanResult

    Notes
    -----
    ``T = v' (X' M X)^-1 v``, v the sums of the pulled residual with cosine and sine, and
    ``X' M X`` the whitened columns' Gram matrix less what the explained columns take from it.
    """
    total, doubled = _norms(space, scan)
    cc, ss = 0.5 * (total + doubled.real), 0.5 * (total - doubled.real)
    cs = -0.5 * doubled.imag
    for column in space.pull_basis.T:
        part = scan.single(column[:, None])[0]
        cc -= part.real**2
        ss -= part.imag**2
        cs += part.real * part.imag
    mean, half = 0.5 * (cc + ss), np.hypot(0.5 * (cc - ss), cs)
    usable = mean - half > _MIN_SHARE * 0.5 * total
    determinant = np.where(usable, cc * ss - cs**2, 1.0)

    def statistic(sums: NDArray[np.complex128]) -> FloatArray:
        c, s = sums.real, -sums.imag
        value = (ss * c**2 - 2.0 * cs * c * s + cc * s**2) / determinant
        return np.where(usable, value, 0.0)

    sums = scan.single(space.pull[:, None])[0]
    c, s = sums.real, -sums.imag
    amplitude = np.hypot(ss * c - cs * s, cc * s - cs * c) / determinant
    sigma = np.where(usable, np.sqrt(np.maximum(mean, 0.0) / determinant), np.inf)
    return ScanResult(
        grid=scan.single.grid,
        statistic=statistic(sums),
        amplitude=np.where(usable, amplitude, 0.0),
        sigma=sigma,
        usable=usable,
        rate=upcrossing_rate(statistic(scan.single(p[:, None])[0]) for p in null_pulls.T),
    )


def upcrossing_rate(draws: Iterable[FloatArray]) -> float:
    """Return W of ``P(max T > c) <= exp(-c/2) (1 + W sqrt(c))`` from draws of the scan.

    Parameters
    ----------
    draws : iterable of ndarray, shape (n_grid,)
        Statistic of white noise, one array for each draw; they need not fit into memory together.

    Returns
    -------
    float
        Mean number of upcrossings at a low level, carried to any level by the law of a chi^2
        field with two degrees of freedom.

    References
    ----------
    .. [1] E. Gross, O. Vitells, Eur. Phys. J. C 70 (2010) 525, arXiv:1005.1891.
    """
    counts = [int(((draw[:-1] <= _LEVEL) & (draw[1:] > _LEVEL)).sum()) for draw in draws]
    # an empty count is known to three at 95 %
    mean = max(sum(counts), 3.0) / max(1, len(counts))
    return float(mean / (np.sqrt(_LEVEL) * np.exp(-_LEVEL / 2.0)))
