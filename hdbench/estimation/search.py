"""Search of lines and orders in a residual, each tested against its chance of being noise."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hdbench.estimation.harmonics import Harmonic, harmonic_at, harmonic_columns
from hdbench.estimation.regression import LinearFit, NoiseModel, coloured_fit, whiten
from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray

# cycles in the record below which a line is not told from a drift
_LOWEST_CYCLES = 3.0
# bins per cycle of the highest order: nearest-bin rounding then loses under 1 % of the power
_BINS_PER_CYCLE = 16
# resolutions within which a neighbour is not told from a change of a component's amplitude
NEIGHBOUR_RESOLUTIONS = 2.0
_MAX_BINS = 1 << 21

Domain = Literal["motor-order", "frequency"]


@dataclass(frozen=True, slots=True)
class Line:
    """A sinusoid in a residual."""

    # what it is locked to
    domain: Domain
    # cycles per motor turn, or Hz
    location: float
    # periodogram value of the whitened residual, exponential with mean 1 under noise
    power: float
    # chance that noise alone shows a line as strong anywhere in the range searched
    false_alarm_probability: float
    # amplitude and phase from the joint regression, once fitted
    component: Harmonic | None = None
    # location in the other domain, where the record cannot tell the two apart (their likelihoods
    # are within 3 nats, as at constant velocity); else None
    equivalent: float | None = None


def _false_alarm(power: float, width: float) -> float:
    """Baluev's bound for the maximum of a periodogram over `width` effective frequencies."""
    tail = math.exp(-power)
    return -math.expm1(math.log1p(-tail) - width * tail * math.sqrt(power))


def _periodogram(white: FloatArray, cycles: FloatArray, location: FloatArray) -> FloatArray:
    """Return the periodogram of unit white noise at given locations, by direct sums."""
    power = np.empty(len(location))
    for i, place in enumerate(location):
        angle = 2.0 * np.pi * place * cycles
        power[i] = (white @ np.cos(angle)) ** 2 + (white @ np.sin(angle)) ** 2
    return power / len(white)


def strongest_line(
    white: FloatArray,
    cycles: FloatArray,
    domain: Domain,
    *,
    taken: tuple[float, ...] = (),
) -> Line | None:
    """Return the strongest sinusoid of a whitened residual.

    Parameters
    ----------
    white : ndarray, shape (n,)
        Whitened residual, unit variance.
    cycles : ndarray, shape (n,)
        Motor turns for ``motor-order``, time in s for ``frequency``.
    domain : {'motor-order', 'frequency'}
        What `cycles` is.
    taken : tuple of float
        Locations already in the model; within two resolutions of them nothing is searched: a
        neighbour that beats less than twice with a component is a change of its amplitude.

    Returns
    -------
    Line or None
        None where the record spans too little.

    Notes
    -----
    The samples are gathered on an even grid of `cycles`, transformed, and the peak refined by
    direct sums. The false-alarm probability is Baluev's bound for the range searched.

    References
    ----------
    .. [1] R. V. Baluev, Mon. Not. R. Astron. Soc. 385 (2008) 1279,
       doi:10.1111/j.1365-2966.2008.12689.x.
    """
    span = float(np.ptp(cycles))
    step = np.abs(np.diff(cycles))
    step = step[step > 0.0]
    if len(step) < 16:
        return None
    # Nyquist by the faster samples of the record, so that little of what is searched folds
    high = min(0.49 / float(np.percentile(step, 90.0)), _MAX_BINS / _BINS_PER_CYCLE / span)
    low = _LOWEST_CYCLES / span
    if not high > 2.0 * low:
        return None
    n_bins = math.ceil(span * high * _BINS_PER_CYCLE) + 1
    where = np.rint((cycles - cycles.min()) * high * _BINS_PER_CYCLE).astype(np.int64)
    grid = np.bincount(where, weights=white, minlength=n_bins)
    size = 1 << (2 * n_bins - 1).bit_length()
    power = np.abs(np.fft.rfft(grid, size)) ** 2 / len(white)
    location = np.arange(len(power)) * (high * _BINS_PER_CYCLE / size)
    searched = (location >= low) & (location <= high)
    for place in taken:
        searched &= np.abs(location - place) > NEIGHBOUR_RESOLUTIONS / span
    if not searched.any():
        return None
    best = float(location[int(np.argmax(np.where(searched, power, -1.0)))])
    for width in (0.5 / span, 0.05 / span):
        fine = best + np.linspace(-width, width, 21)
        sums = _periodogram(white, cycles, fine)
        best, top = float(fine[int(np.argmax(sums))]), float(np.max(sums))
    effective = (high - low) * math.sqrt(4.0 * math.pi * float(np.var(cycles)))
    return Line(domain, best, top, _false_alarm(top, effective))


# the order is looked for within this share of the nominal one, or 1.5 resolutions if that is more
_RANGE_SHARE = 0.01
_RANGE_RESOLUTIONS = 1.5
# and never beyond so many resolutions: a longer search would meet the neighbours of the line
_MOST_RESOLUTIONS = 20.0
# steps per resolution of the search: fine enough for the last steps to converge
_STEPS_PER_RESOLUTION = 5.0
# gain of likelihood, in units of the noise, below which an order is not estimated: 5 sigma
_LEAST_GAIN = 25.0


@dataclass(frozen=True, slots=True)
class _Projected:
    """A whitened record with everything else projected out, to be fitted by one order."""

    angle_rad: FloatArray
    used: NDArray[np.bool_]
    noise: NoiseModel
    starts: NDArray[np.bool_] | None
    basis: FloatArray
    target: FloatArray

    @property
    def middle_rad(self) -> float:
        """Middle of the angle's range, about which an order's slope is nearly orthogonal, rad."""
        angle = self.angle_rad[self.used]
        return 0.5 * float(np.max(angle) + np.min(angle))

    def solve(
        self, order: float, about: FloatArray | None = None
    ) -> tuple[FloatArray, float, FloatArray]:
        """Return coefficients at `order`, the gain of likelihood, and the inverse normal matrix.

        With `about`, cosine and sine coefficients, the slope over the order is a third column.
        """
        columns = harmonic_columns(self.angle_rad, [order])
        if about is not None:
            slope = about[1] * columns[:, 0] - about[0] * columns[:, 1]
            columns = np.column_stack([columns, (self.angle_rad - self.middle_rad) * slope])
        table = whiten(columns, self.noise, self.used, starts=self.starts)[self.used]
        table = table - self.basis @ (self.basis.T @ table)
        inverse = np.asarray(np.linalg.pinv(table.T @ table, hermitian=True), dtype=np.float64)
        solution = inverse @ (table.T @ self.target)
        return solution, float(solution @ (table.T @ self.target)), inverse


@dataclass(frozen=True, slots=True)
class OrderEstimate:
    """An order measured from the record."""

    order: Quantity
    gain: float  # squares of the whitened residual that the component explains


def refine_order(
    nominal: float,
    fit: LinearFit,
    others: FloatArray,
    response: FloatArray,
    angle_rad: FloatArray,
    *,
    starts: NDArray[np.bool_] | None = None,
) -> OrderEstimate | None:
    """Measure the order of a component near a nominal one.

    Notes
    -----
    Nonlinear least squares on whitened data by variable projection: the gain of likelihood is
    searched on a grid of a fifth of the resolution ``1 / turns``, then Gauss-Newton steps with
    the column ``angle * (b cos - a sin)``. The uncertainty is that of this column's coefficient
    in the joint fit, with the dof of `fit`.

    References
    ----------
    .. [1] G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413, doi:10.1137/0710036.
    """
    if fit.noise is None:
        return None
    turns = float(np.ptp(angle_rad[fit.used])) / (2.0 * math.pi)
    if not turns > 2.0 / nominal:
        return None
    table = whiten(np.column_stack([others, response]), fit.noise, fit.used, starts=starts)
    basis, _ = np.linalg.qr(table[fit.used, :-1])
    target = table[fit.used, -1]
    target = target - basis @ (basis.T @ target)
    record = _Projected(angle_rad, fit.used, fit.noise, starts, basis, target)
    resolution = 1.0 / turns
    half = min(
        max(_RANGE_SHARE * nominal, _RANGE_RESOLUTIONS * resolution), _MOST_RESOLUTIONS * resolution
    )
    order = _coarse(record, nominal, half, resolution)
    if order is None:
        return None
    order, gain, unit_variance = _refined(record, order, resolution)
    free = max(1.0, len(target) - others.shape[1] - 3)
    variance = max(float(target @ target) - gain, 0.0) / free
    if not (abs(order - nominal) <= half and unit_variance > 0.0):
        return None
    std = math.sqrt(variance * unit_variance)
    return OrderEstimate(Quantity(order, std, fit.dof), gain / variance if variance > 0.0 else gain)


def _coarse(record: _Projected, nominal: float, half: float, resolution: float) -> float | None:
    """Return the best order of a grid, or None where it is weak or lies at the end."""
    n_steps = math.ceil(half / resolution * _STEPS_PER_RESOLUTION)
    grid = nominal + np.linspace(-half, half, 2 * n_steps + 1)
    gains = [record.solve(float(order))[1] for order in grid]
    best = int(np.argmax(gains))
    if best in (0, len(grid) - 1) or not gains[best] > _LEAST_GAIN:
        return None
    return float(grid[best])


def _refined(record: _Projected, order: float, resolution: float) -> tuple[float, float, float]:
    """Return the order after Gauss-Newton steps, its gain, and the variance per unit noise."""
    pair, gain, _ = record.solve(order)
    unit_variance = 0.0
    # from a fifth of the resolution the steps converge quadratically: four reach rounding
    for _ in range(4):
        solution, _, inverse = record.solve(order, pair)
        unit_variance = float(inverse[2, 2])
        order += float(np.clip(solution[2], -resolution, resolution))
        pair, gain, _ = record.solve(order)
    return order, gain, unit_variance


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
    """A regression with the lines that its residual showed."""

    # joint fit; the first columns are those asked for, then two per line
    fit: LinearFit
    # lines found, in the order found
    lines: tuple[Line, ...]
    # shape (n, k + 2 m): Columns of the fit: those asked for, then cosine and sine of each line
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
        place = _Place.without(turns, time_s[fit.used], orders, lines + passed)
        found = place.next_line(white)
        if found is None:
            break
        beside = place.strongest(fit.residual[fit.used] / fit.rms) if place.reverses else []
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


@dataclass(frozen=True, slots=True)
class _Place:
    """Where lines of a record are looked for: all but those that are known."""

    turns: FloatArray
    time_s: FloatArray
    orders: tuple[float, ...]  # orders and frequencies at which nothing new can be named
    tones: tuple[float, ...]

    @classmethod
    def without(
        cls, turns: FloatArray, time_s: FloatArray, orders: tuple[float, ...], lines: list[Line]
    ) -> _Place:
        """Return a record without what is in the model."""
        at_orders = orders + tuple(x.location for x in lines if x.domain == "motor-order")
        at_tones = tuple(x.location for x in lines if x.domain == "frequency")
        slow, fast = (float(q) for q in np.percentile(_rate(turns, time_s), (5.0, 95.0)))
        also_tones = _seen_as(at_orders, slow, fast, float(np.ptp(time_s)))
        span = float(np.ptp(turns))
        # a motor at rest turns a tone into no order at all
        also_orders = _seen_as(at_tones, 1.0 / fast, 1.0 / slow, span) if slow else ()
        return cls(turns, time_s, at_orders + also_orders, at_tones + also_tones)

    @property
    def reverses(self) -> bool:
        """Whether the motor turns both ways."""
        backward, forward = np.percentile(np.diff(self.turns), (5.0, 95.0))
        return bool(backward < 0.0 < forward)

    def strongest(self, white: FloatArray) -> list[Line]:
        """Return the strongest line of each domain that is not known yet."""
        candidates = (
            strongest_line(white, self.turns, "motor-order", taken=self.orders),
            strongest_line(white, self.time_s, "frequency", taken=self.tones),
        )
        return [line for line in candidates if line is not None]

    def next_line(self, white: FloatArray) -> Line | None:
        """Return the strongest line that is not known yet; None where noise shows as much."""
        found = self.strongest(white)
        if not found:
            return None
        best = max(found, key=lambda line: line.power)
        probability = min(1.0, len(found) * best.false_alarm_probability)
        if not probability < FALSE_ALARM_LEVEL:
            return None
        # with both domains alike the motor is named first: that is what turns on this bench
        chosen = next(x for x in found if x.power > best.power - _UNDECIDED_NATS)
        other = next((x for x in found if x is not chosen), None)
        same = other is not None and _same_line(chosen, other, self.turns, self.time_s)
        return replace(
            chosen,
            false_alarm_probability=probability,
            equivalent=other.location if other is not None and same else None,
        )


def _overlap(columns: FloatArray, extra: FloatArray) -> float:
    """Return the share of the most explained column of `extra` that `columns` explain."""
    basis, _ = np.linalg.qr(columns)
    inside = basis.T @ extra
    return float(np.max((inside**2).sum(axis=0) / (extra**2).sum(axis=0)))


def _rate(turns: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the speed in turns per second."""
    # over a hundredth of the record, so that jitter of single samples is not taken for speed
    lag = max(1, len(turns) // 100)
    return np.abs((turns[lag:] - turns[:-lag]) / (time_s[lag:] - time_s[:-lag]))


def _same_line(one: Line, other: Line, turns: FloatArray, time_s: FloatArray) -> bool:
    """Say whether an order and a frequency are one line at this speed, and equally likely."""
    if not other.power > one.power - _UNDECIDED_NATS:
        return False
    order, tone = (one, other) if one.domain == "motor-order" else (other, one)
    apart = order.location * float(np.median(_rate(turns, time_s))) - tone.location
    return abs(apart) * float(np.ptp(time_s)) < NEIGHBOUR_RESOLUTIONS


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
