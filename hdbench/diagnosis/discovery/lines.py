"""Lines and steps: scans of a residual over motor order, output order, frequency and time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.discovery.dictionary import Look
from hdbench.diagnosis.discovery.fit import Fit
from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.tables import TABLE
from hdbench.diagnosis.discovery.term import Term
from hdbench.diagnosis.discovery.transform import PhaseTransform, plan_transform
from hdbench.model import Cause, Motion, Parameter
from hdbench.records.trace import FloatArray

__all__ = [
    "OUTPUT_LINE",
    "TONE_LINE",
    "Scan",
    "line_norm",
    "plan_scans",
    "scan_looks",
    "step_look",
]

Columns = Callable[[Motion, Mapping[str, float]], FloatArray]

# points per resolution cell of a scan
_PER_CELL = 4
# orders: from a quarter turn's line up; above Nyquist true sample angles still tell a line
_LOWEST_ORDER, _HIGHEST_ORDER = 0.25, 80.0
_ABOVE_NYQUIST = 1.2
# whole orders that are known places
_WHOLE_ORDERS = 24
# highest output order of a scan
_OUTPUT_ORDERS = 20.0
# lines of one axis that are looked at closely at a time
_PEAKS = 5
# cells on each side by which the noise around a line is judged: a hump, and what is around it
_AROUND = ((1, 5), (3, 24))
# median of chi^2 with two degrees of freedom
_MEDIAN = 2.0 * np.log(2.0)
# points at which the information on a line is formed; it changes slowly along the axis
_NORM_POINTS = 2000
# a line takes this share of its information from other frequencies: record and speed are not even
_LEAKS = 1e-4
# places at which the norm of a step is formed; between them it is interpolated
_STEPS = 17


def _pair(phase: FloatArray) -> FloatArray:
    return np.column_stack([np.cos(phase), np.sin(phase)])


def _at_output_order(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    return _pair(shape["output_order"] * motion.output_angle_rad)


def _at_frequency(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    return _pair(2.0 * np.pi * shape["frequency_hz"] * motion.time_s)


def _line(name: str, place: Parameter, locked_to: str, columns: Columns) -> Cause:
    pair = tuple(Parameter(f"{p}_nm", "N m", -1e6, 1e6, p) for p in ("cosine", "sine"))
    return Cause(
        TABLE + name,
        "a line",
        (place,),
        pair,
        locked_to,
        "",
        "",
        (),
        "",
        "",
        columns,
        True,
    )


OUTPUT_LINE = _line(
    "output-line",
    Parameter("output_order", "1", 0.05, 1e3, "cycles per output turn"),
    "output",
    _at_output_order,
)
TONE_LINE = _line(
    "tone", Parameter("frequency_hz", "Hz", 1e-6, 1e6, "frequency"), "clock", _at_frequency
)


@dataclass(frozen=True, slots=True)
class Scan:
    """One axis of lines.

    Parameters
    ----------
    domain, unit : str
        Domain of the contract and unit of the axis.
    phase_rad : ndarray, shape (n_samples,)
        Phase of a line at 1 on the axis; 0 where not valid.
    transform : PhaseTransform
        Sums over the grid.
    cell : float
        Width of a line.
    density : float
        Expected upcrossings of a chi^2 of two over the axis, over ``sqrt(c / 2) exp(-c / 2)``.
    """

    domain: str
    unit: str
    phase_rad: FloatArray
    transform: PhaseTransform
    cell: float
    density: float


def plan_scans(record: Record) -> tuple[Scan, ...]:
    """Return the scans that this record allows."""
    motion, valid = record.motion, record.valid
    speed = np.abs(motion.velocity_rad_s[valid])
    nyquist_hz = 0.5 / record.period_s
    turning = float(np.median(speed[speed > 0.05 * speed.max()])) if speed.max() > 0.0 else 0.0
    top = min(_HIGHEST_ORDER, _ABOVE_NYQUIST * 2.0 * np.pi * nyquist_hz / max(turning, 1e-9))
    plans = [
        ("motor-order", "1", motion.angle_rad, _LOWEST_ORDER, top, 3.0),
        ("frequency", "Hz", 2.0 * np.pi * (motion.time_s - motion.time_s[0]), 0.0, nyquist_hz, 2.0),
        (
            "output-order",
            "1",
            motion.output_angle_rad,
            0.5,
            min(_OUTPUT_ORDERS, 0.25 * motion.gear_ratio),
            1.0,
        ),
    ]
    scans = []
    for domain, unit, phase, low, high, cycles in plans:
        cycle = np.where(valid, phase, 0.0) / (2.0 * np.pi)
        span = float(np.ptp(cycle[valid]))
        if span < 1.0:
            continue
        low = max(low, cycles / span)
        if high <= low:
            continue
        present = np.flatnonzero(valid)
        positions = np.interp(np.arange(len(cycle)), present, cycle[present])
        transform = plan_transform(positions, 1.0 / (_PER_CELL * span), low, high)
        spread = float(np.std(cycle[valid]))
        density = float(np.sqrt(4.0 * np.pi)) * spread * (high - low)
        scans.append(Scan(domain, unit, 2.0 * np.pi * positions, transform, 1.0 / span, density))
    return tuple(scans)


def scan_power(
    fit: Fit, scan: Scan, residual: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the statistic of a line at each point of a scan, and its amplitude, N m."""
    bands = fit.bands
    left = fit.residual if residual is None else residual
    weighted = bands.inverse(left * bands.spread(1.0 / fit.spectrum.power))
    weighted = np.where(fit.record.valid, weighted, 0.0)
    sums = np.abs(scan.transform(weighted)) ** 2
    norm = line_norm(fit, scan, np.ones(len(weighted)))
    statistic = sums / norm
    return statistic, np.sqrt(statistic / norm)


def line_norm(fit: Fit, scan: Scan, share: FloatArray) -> FloatArray:
    """Return the information on a line at each point of a scan, samples weighed by their share.

    A line stands at its rate times the order in each sample; above half the sampling rate it is
    folded back.
    """
    bands = fit.bands
    places = np.arange(bands.size) / (2.0 * bands.length * fit.record.period_s)
    seen = bands.spread(1.0 / fit.spectrum.power) * bands.passed**2
    # the noise is even in samples, whatever their stamps say
    rate = np.abs(np.gradient(scan.phase_rad)) / (2.0 * np.pi * fit.record.period_s)
    used = fit.record.valid
    count, edges = np.histogram(rate[used], 48, weights=(share * bands.fade**2)[used])
    middle = 0.5 * (edges[1:] + edges[:-1])
    nyquist = 0.5 / fit.record.period_s
    grid = scan.transform.grid
    few = grid[:: max(1, len(grid) // _NORM_POINTS)]
    norm = np.zeros(len(few))
    for part, speed in zip(count, middle, strict=True):
        if part > 0.0:
            f = np.abs(few * speed)
            folded = np.abs((f + nyquist) % (2.0 * nyquist) - nyquist)
            norm += 0.5 * part * np.interp(folded, places, seen, right=0.0)
    return np.interp(grid, few, np.maximum(norm, max(_LEAKS * norm.max(), 1e-300)))


def scan_looks(fit: Fit, scans: tuple[Scan, ...], causes: Mapping[str, Cause]) -> list[Look]:
    """Return the strongest lines of every axis with the names that they may have."""
    found = []
    for scan in scans:
        statistic, _ = scan_power(fit, scan)
        peaks = _peaks(statistic)
        if not peaks:
            continue
        exact, without = _line_by_line(fit, scan, peaks)
        around = scan_power(fit, scan, without)[0]
        for at, value in zip(peaks, exact, strict=True):
            share = 1.0 / _noise_around(around, at)
            found += _named(scan, float(scan.transform.grid[at]), value, share, causes)
    return found


def _peaks(statistic: FloatArray) -> list[int]:
    """Return the points of the strongest lines, one in each hump."""
    left, width = statistic.copy(), _AROUND[0][1] * _PER_CELL
    peaks: list[int] = []
    for _ in range(_PEAKS):
        at = int(np.argmax(left))
        if left[at] < 8.0:
            break
        peaks.append(at)
        left[max(0, at - width) : at + width + 1] = 0.0
    return peaks


def _line_by_line(fit: Fit, scan: Scan, peaks: list[int]) -> tuple[list[float], FloatArray]:
    """Return the statistic of each line alone, and the residual without the strongest.

    Where the speed changes a line leaks along the axis, and is no noise there.
    """
    columns = [_pair(float(scan.transform.grid[at]) * scan.phase_rad) for at in peaks]
    rows = fit.bands.transform(np.column_stack(columns)).reshape(len(peaks), 2, -1)
    weight = fit.bands.spread(1.0 / fit.spectrum.power)
    alone, left = [], []
    for pair in rows:
        white = pair * weight
        right = white @ fit.residual
        amount = np.linalg.lstsq(white @ pair.T, right, 1e-6)[0]
        alone.append(float(amount @ right))
        left.append(amount)
    most = int(np.argmax(alone))
    return alone, np.asarray(fit.residual - left[most] @ rows[most])


def _noise_around(statistic: FloatArray, at: int) -> float:
    """Return the noise around a point relative to what is expected: a hump is no line."""
    found = [1.0]
    for first, last in _AROUND:
        near, far = first * _PER_CELL, last * _PER_CELL
        some = np.r_[
            statistic[max(0, at - far) : max(0, at - near)], statistic[at + near : at + far]
        ]
        if len(some) > far // 2:
            found.append(float(np.median(some)) / _MEDIAN)
    return max(found)


def _named(
    scan: Scan, place: float, value: float, share: float, causes: Mapping[str, Cause]
) -> list[Look]:
    """Return the names that a line at a place may have, with their false-alarm probabilities."""
    free = _chance_anywhere(value * share, scan.density)
    tail = float(np.exp(-0.5 * value * share))
    out = []

    def add(cause: Cause | None, key: str, at: float, trials: float, chance: float) -> None:
        bands = (
            ()
            if cause is None
            else (cause.shape[0].bands or ((cause.shape[0].lower, cause.shape[0].upper),))
        )
        if cause is not None and any(a <= at <= b for a, b in bands):
            out.append(Look(Term(cause, {key: at}), value, 2, trials, chance))

    cells = max(2.0, scan.density)
    if scan.domain == "motor-order":
        whole = float(round(place))
        near = abs(place - whole) < 0.5 * scan.cell and whole >= 1.0
        if near:
            known = float(_WHOLE_ORDERS) if whole <= _WHOLE_ORDERS else 2.0 * whole
            chance = -np.expm1(known * np.log1p(-min(tail, 1.0 - 1e-16)))
            add(causes.get("ripple-harmonic"), "order", whole, known, float(chance))
            for part in (1.0, 2.0, 3.0):
                if whole % part == 0.0:
                    add(causes.get("cogging"), "order", whole / part, known, float(chance))
        if not near or abs(place - whole) > 0.25 * scan.cell:
            add(causes.get("ripple-harmonic"), "order", place, cells, free)
        for part in (1.0, 2.0, 3.0):
            add(causes.get("bearing-defect"), "order", place / part, cells, free)
    elif scan.domain == "frequency":
        mains = causes.get("mains-hum")
        if mains is not None:
            known = max(2.0, sum(b - a for a, b in mains.shape[0].bands) / scan.cell)
            chance = -np.expm1(known * np.log1p(-min(tail, 1.0 - 1e-16)))
            add(mains, "frequency_hz", place, known, float(chance))
        add(causes.get("structural-tone"), "frequency_hz", place, cells, free)
        if not out:
            add(TONE_LINE, "frequency_hz", place, cells, free)
    else:
        add(OUTPUT_LINE, "output_order", place, cells, free)
    return out


def _chance_anywhere(value: float, density: float) -> float:
    """Return the chance of a chi^2 of two this large anywhere on an axis (Davies 1987)."""
    tail = float(np.exp(-0.5 * value))
    return float(min(1.0, tail * (1.0 + density * np.sqrt(0.5 * value))))


def step_look(fit: Fit, cause: Cause) -> Look | None:
    """Return the best step of the zero at any sample.

    References
    ----------
    .. [1] B. James, K. L. James, D. Siegmund, Biometrika 74 (1987) 71, doi:10.1093/biomet/74.1.71
       (largest of a step at any sample).
    """
    record, bands = fit.record, fit.bands
    n = len(record)
    beside = fit.beside()
    weighted = bands.inverse(fit.residual * beside.whitening)
    tail = np.cumsum(weighted[::-1])[::-1]
    margin = max(10, n // 50)
    places = np.linspace(margin, n - margin, _STEPS).astype(int)
    columns = (np.arange(n)[:, None] >= places[None, :]).astype(float)
    rows = bands.transform(columns - columns.mean(axis=0))
    norms = np.diag(beside.project(rows)[0])
    norm = np.interp(np.arange(n), places, norms)
    total = float(weighted.sum())
    tail = tail - total * (1.0 - np.arange(n) / n)
    statistic = np.where(norm > 0.0, tail**2 / np.maximum(norm, 1e-300), 0.0)
    statistic[: margin // 2] = statistic[n - margin // 2 :] = 0.0
    at = int(np.argmax(statistic))
    value, h = float(statistic[at]), margin / 2.0 / n
    if value < 4.0:
        return None
    logs = 2.0 * np.log((1.0 - h) / h)
    density = np.sqrt(value / (2.0 * np.pi)) * ((1.0 - 1.0 / value) * logs + 4.0 / value)
    chance = float(min(1.0, np.exp(-0.5 * value) * density))
    time = float(record.motion.time_s[at])
    trials = max(1.0, chance / max(float(np.exp(-0.5 * value)), 1e-300))
    return Look(Term(cause, {"step_time_s": time}), value, 1, trials, chance)
