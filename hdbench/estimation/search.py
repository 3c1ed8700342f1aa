"""Further lines in a residual, locked to the motor or to the clock, fitted jointly."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.estimation.harmonics import harmonic_at, harmonic_columns
from hdbench.estimation.regression import LinearFit, coloured_fit
from hdbench.estimation.scan import NEIGHBOUR_RESOLUTIONS, Line, strongest_line
from hdbench.estimation.whitening import whiten
from hdbench.records.trace import FloatArray

__all__ = ["FALSE_ALARM_LEVEL", "LineFit", "fit_with_lines"]

# a line is reported when noise alone would show one as strong once in a thousand records
FALSE_ALARM_LEVEL = 1e-3
_MAX_LINES = 12
# likelihoods this close (a factor of 20) do not decide between motor and clock
_UNDECIDED_NATS = 3.0
# a candidate of which the model already explains more than this on the samples used adds nothing
_LARGEST_OVERLAP = 0.5
# resolutions over which a line of one domain may spread in the other and still look like a line
_LINE_WIDTH = 3.0


@dataclass(frozen=True, slots=True)
class LineFit:
    """A regression with the lines that its residual showed.

    Parameters
    ----------
    fit : LinearFit
        Joint fit; the first columns are those asked for, then two per line.
    lines : tuple of Line
        Lines found, in the order found.
    design : ndarray, shape (n, k + 2 m)
        Columns of the fit: those asked for, then cosine and sine of each line.
    """

    fit: LinearFit
    lines: tuple[Line, ...]
    design: FloatArray


@dataclass(frozen=True, slots=True)
class _Trial:
    """A joint fit with one line more."""

    line: Line
    columns: FloatArray
    fit: LinearFit

    @property
    def nats(self) -> float:
        """Gaussian log likelihood but for a constant, at the fit's own noise."""
        noise = self.fit.noise
        scale = self.fit.rms if noise is None else noise.innovation_std
        return -self.fit.n_samples * math.log(scale) if scale > 0.0 else math.inf


def fit_with_lines(
    design: FloatArray,
    response: FloatArray,
    valid: NDArray[np.bool_],
    *,
    motor_angle_rad: FloatArray,
    time_s: FloatArray,
    orders: tuple[float, ...],
    starts: NDArray[np.bool_] | None = None,
) -> LineFit:
    """Fit a design, and add every line that the residual shows, motor order or frequency.

    Parameters
    ----------
    design : ndarray, shape (n, k)
        Columns of the model asked for.
    response : ndarray, shape (n,)
        Response, N m.
    valid : ndarray of bool, shape (n,)
        Samples that may be used.
    motor_angle_rad : ndarray, shape (n,)
        Motor angle, rad.
    time_s : ndarray, shape (n,)
        Time, s.
    orders : tuple of float
        Motor orders that `design` already holds.
    starts : ndarray of bool, shape (n,), optional
        Where a new stretch begins.

    Returns
    -------
    LineFit

    Raises
    ------
    ValueError
        If samples are too few or columns cannot be told apart.

    Notes
    -----
    The stronger of the two domains is taken, the motor order where they are within 3 nats, while
    twice its false-alarm probability (two domains) is below `FALSE_ALARM_LEVEL`, at most twelve
    times; then all are fitted jointly. A line left in the residual would bias its neighbours. A
    candidate of which the model already explains half on these samples is passed over.

    Where the motor reverses, a strong order is no line over time: the noise model takes it for
    colour, and whitening turns its phase one way in each direction. So the strongest lines of the
    residual itself stand beside the one found, and the joint fit decides between them.
    """
    lines: list[Line] = []
    passed: list[Line] = []
    columns = design
    fit = coloured_fit(columns, response, valid, starts=starts)
    while len(lines) + len(passed) < _MAX_LINES and fit.noise is not None:
        white = whiten(fit.residual, fit.noise, fit.used, starts=starts)[fit.used]
        turns = motor_angle_rad[fit.used] / (2.0 * np.pi)
        found = _next_line(white, turns, time_s[fit.used], orders, lines + passed)
        if found is None:
            break
        beside = _unwhitened(fit, turns, time_s[fit.used], orders, lines + passed)
        best = None
        for line in (found, *beside):
            turn = motor_angle_rad if line.domain == "motor-order" else 2.0 * np.pi * time_s
            extra = harmonic_columns(turn, [line.location])
            if _overlap(columns[fit.used], extra[fit.used]) > _LARGEST_OVERLAP:
                continue
            wider = np.hstack([columns, extra])
            trial = _Trial(line, wider, coloured_fit(wider, response, valid, starts=starts))
            if best is None or trial.nats > best.nats + _UNDECIDED_NATS:
                best = trial
        if best is None:
            passed.append(found)
            continue
        columns, fit = best.columns, best.fit
        # it is there at all by the whitened residual; the joint fit says no more than where
        sure = found.false_alarm_probability
        lines.append(
            found if best.line is found else replace(best.line, false_alarm_probability=sure)
        )
    k = design.shape[1]
    fitted = tuple(
        replace(line, component=harmonic_at(fit, k + 2 * i)) for i, line in enumerate(lines)
    )
    return LineFit(fit, fitted, columns)


def _unwhitened(
    fit: LinearFit,
    turns: FloatArray,
    time_s: FloatArray,
    orders: tuple[float, ...],
    lines: list[Line],
) -> list[Line]:
    """Return the strongest line of each domain in the plain residual, where the motor reverses."""
    backward, forward = np.percentile(np.diff(turns), (5.0, 95.0))
    if not backward < 0.0 < forward:
        return []
    taken_orders, taken_tones = _taken(turns, time_s, _rate(turns, time_s), orders, lines)
    white = fit.residual[fit.used] / fit.rms
    candidates = (
        strongest_line(white, turns, "motor-order", taken=taken_orders),
        strongest_line(white, time_s, "frequency", taken=taken_tones),
    )
    return [line for line in candidates if line is not None]


def _overlap(columns: FloatArray, extra: FloatArray) -> float:
    """Return the share of the most explained column of `extra` that `columns` explain."""
    basis, _ = np.linalg.qr(columns)
    inside = basis.T @ extra
    return float(np.max((inside**2).sum(axis=0) / (extra**2).sum(axis=0)))


def _next_line(
    white: FloatArray,
    turns: FloatArray,
    time_s: FloatArray,
    orders: tuple[float, ...],
    lines: list[Line],
) -> Line | None:
    """Return the strongest line that is not known yet, or None where noise alone shows as much."""
    rate = _rate(turns, time_s)
    taken_orders, taken_tones = _taken(turns, time_s, rate, orders, lines)
    candidates = [
        strongest_line(white, turns, "motor-order", taken=taken_orders),
        strongest_line(white, time_s, "frequency", taken=taken_tones),
    ]
    found = [line for line in candidates if line is not None]
    if not found:
        return None
    best = max(found, key=lambda line: line.power)
    probability = min(1.0, len(found) * best.false_alarm_probability)
    if not probability < FALSE_ALARM_LEVEL:
        return None
    # with both domains alike the motor is named first: that is what turns on this bench
    chosen = next(x for x in found if x.power > best.power - _UNDECIDED_NATS)
    other = next((x for x in found if x is not chosen), None)
    same = other is not None and _same_line(
        chosen, other, float(np.median(rate)), float(np.ptp(time_s))
    )
    return replace(
        chosen,
        false_alarm_probability=probability,
        equivalent=other.location if other is not None and same else None,
    )


def _rate(turns: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the speed in turns per second."""
    # over a hundredth of the record, so that jitter of single samples is not taken for speed
    lag = max(1, len(turns) // 100)
    return np.abs((turns[lag:] - turns[:-lag]) / (time_s[lag:] - time_s[:-lag]))


def _taken(
    turns: FloatArray,
    time_s: FloatArray,
    rate: FloatArray,
    orders: tuple[float, ...],
    lines: list[Line],
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return orders and frequencies at which nothing new can be named."""
    at_orders = orders + tuple(x.location for x in lines if x.domain == "motor-order")
    at_tones = tuple(x.location for x in lines if x.domain == "frequency")
    slow, fast = (float(q) for q in np.percentile(rate, (5.0, 95.0)))
    also_tones = _seen_as(at_orders, slow, fast, float(np.ptp(time_s)))
    # a motor at rest turns a tone into no order at all
    also_orders = _seen_as(at_tones, 1.0 / fast, 1.0 / slow, float(np.ptp(turns))) if slow else ()
    return at_orders + also_orders, at_tones + also_tones


def _same_line(one: Line, other: Line, turns_per_s: float, duration_s: float) -> bool:
    """Say whether an order and a frequency are one line at this speed, and equally likely."""
    if not other.power > one.power - _UNDECIDED_NATS:
        return False
    order, tone = (
        (one.location, other.location)
        if one.domain == "motor-order"
        else (other.location, one.location)
    )
    return abs(order * turns_per_s - tone) * duration_s < NEIGHBOUR_RESOLUTIONS


def _seen_as(places: tuple[float, ...], slow: float, fast: float, span: float) -> tuple[float, ...]:
    """Return where lines of one domain appear in the other, if they are lines there too.

    A line at `place` spreads over ``place * slow ... place * fast``; above three resolutions
    ``1 / span`` it is no line any more.
    """
    found: list[float] = []
    for place in places:
        width = place * (fast - slow) * span
        if width < _LINE_WIDTH:
            found.extend(np.linspace(place * slow, place * fast, 2 + math.ceil(width)).tolist())
    return tuple(found)
