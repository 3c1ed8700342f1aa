"""Lines and steps: scans of a residual over motor order, output order, frequency and time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import gamma

from hdbench.diagnosis.discovery.dictionary import Look, explained
from hdbench.diagnosis.discovery.fit import Beside, Fit, scaled_rows
from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.stack import Glance, glances, piece_fit, records_of
from hdbench.diagnosis.discovery.tables import TABLE, Axis, Table, axes_of
from hdbench.diagnosis.discovery.term import Term
from hdbench.diagnosis.discovery.transform import PhaseTransform, plan_transform
from hdbench.diagnosis.evidence import SAME_SPACE, any_of, chi2_level, chi2_tail, scaled
from hdbench.model import Cause, Motion, Parameter
from hdbench.records.trace import FloatArray

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
# lines of one axis that are looked at closely at a time, and the smallest statistic of one
_PEAKS, _LEAST_PEAK = 5, 8.0
# cells on each side by which the noise around a line is judged: a hump, and what is around it
_AROUND = ((1, 5), (3, 24))
# points at which the information on a line is formed, which changes slowly along the axis, and
# rates of turning that are told apart for it
_NORM_POINTS, _RATES = 2000, 48
# a line takes this share of its information from other frequencies: record and speed are not even
_LEAKS = 1e-4
# places at which the norm of a step is formed; between them it is interpolated
_STEPS = 17
# steps of the zero that a record may have
_FEW_STEPS = 3
# knots over the other axis, and over a turn, where an envelope may have several waves
_ENVELOPE_KNOTS, _TURN_KNOTS = 5, 24


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
_MOTOR_ORDER = Parameter("order", "1", 0.05, 1e3, "cycles per turn of the motor")


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
    parts : tuple of Scan
        Scans of the records of a stack on one grid; empty for one record.
    whole : tuple of PhaseTransform
        Sums at whole orders over the angle within a turn, of each record of a stack whose angles
        have one zero; empty for all others.
    """

    domain: str
    unit: str
    phase_rad: FloatArray
    transform: PhaseTransform
    cell: float
    density: float
    parts: tuple[Scan, ...] = ()
    whole: tuple[PhaseTransform, ...] = ()

    @property
    def dof(self) -> int:
        """Degrees of freedom of a line: cosine and sine, in each record of a stack its own."""
        return 2 * max(1, len(self.parts))


def plan_scans(record: Record) -> tuple[Scan, ...]:
    """Return the scans that a record allows, or all records of a stack do."""
    records = records_of(record)
    every = [_axes(one) for one in records]
    scans = []
    for domain in every[0]:
        axes = [some[domain] for some in every if domain in some]
        low, high = max(axis.low for axis in axes), min(axis.high for axis in axes)
        if len(axes) < len(records) or high <= low:
            continue
        span = max(axis.span for axis in axes)
        parts = tuple(
            Scan(
                domain,
                axis.unit,
                2.0 * np.pi * axis.cycles,
                plan_transform(axis.cycles, 1.0 / (_PER_CELL * span), low, high),
                1.0 / span,
                float(np.sqrt(4.0 * np.pi)) * axis.spread * (high - low),
            )
            for axis in axes
        )
        widest = max(parts, key=lambda part: part.density)
        if len(parts) == 1:
            scans.append(widest)
            continue
        whole: tuple[PhaseTransform, ...] = ()
        if record.referenced and domain == "motor-order" and high >= 1.0:
            turns = (axis.cycles % 1.0 for axis in axes)
            whole = tuple(plan_transform(turn, 1.0, 1.0, high) for turn in turns)
        phase = np.concatenate([part.phase_rad for part in parts])
        scans.append(replace(widest, phase_rad=phase, parts=parts, whole=whole))
    return tuple(scans)


@dataclass(frozen=True, slots=True)
class _Axis:
    """Cycles at every sample of a record, their span and scatter, and the ends of a scan."""

    unit: str
    cycles: FloatArray
    span: float
    spread: float
    low: float
    high: float


def _axes(record: Record) -> dict[str, _Axis]:
    """Return the axes of lines of one record by domain."""
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
    axes = {}
    present = np.flatnonzero(valid)
    for domain, unit, phase, low, high, cycles in plans:
        cycle = np.where(valid, phase, 0.0) / (2.0 * np.pi)
        span = float(np.ptp(cycle[valid]))
        if span < 1.0:
            continue
        low = max(low, cycles / span)
        if high <= low:
            continue
        positions = np.interp(np.arange(len(cycle)), present, cycle[present])
        axes[domain] = _Axis(unit, positions, span, float(np.std(cycle[valid])), low, high)
    return axes


def scan_power(
    fit: Fit, scan: Scan, residual: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the statistic of a line at each point of a scan, and its amplitude, N m.

    In a stack the statistics of the records add, and the amplitude is their mean.
    """
    sums, norms = _sums(fit, scan, residual)
    statistic = np.sum([np.abs(s) ** 2 / n for s, n in zip(sums, norms, strict=True)], axis=0)
    return statistic, np.sqrt(statistic / np.sum(norms, axis=0))


def _sums(
    fit: Fit, scan: Scan, residual: FloatArray | None = None, *, whole: bool = False
) -> tuple[list[NDArray[np.complex64]], list[FloatArray]]:
    """Return sums and norms of the records at each point of a scan, or at whole orders."""
    sums, norms = [], []
    for at, (one, part) in enumerate(
        zip(glances(fit, residual), scan.parts or (scan,), strict=True)
    ):
        bands = one.bands
        weighted = bands.inverse(one.residual * bands.spread(1.0 / one.noise))
        weighted = np.where(one.record.motion.valid, weighted, 0.0)
        transform = scan.whole[at] if whole else part.transform
        norm = line_norms(one, part, (), partial(np.ones, (1, len(weighted))))[0]
        sums.append(transform(weighted))
        norms.append(np.interp(transform.grid, part.transform.grid, norm) if whole else norm)
    return sums, norms


def line_norms(
    glance: Glance, scan: Scan, name: tuple[str, ...], shares: Callable[[], FloatArray]
) -> FloatArray:
    """Return the information on a line at each point of a scan, samples weighed by their shares.

    A line stands at its rate times the order in each sample; above half the sampling rate it is
    folded back. `shares` makes a row for each weighing of this name, shape (m, n_samples), and the
    result has one for each, too.
    """
    bands, period = glance.bands, glance.record.period_s
    places = np.arange(bands.size) / (2.0 * bands.length * period)
    seen = bands.spread(1.0 / glance.noise) * bands.passed**2

    def counted() -> FloatArray:
        """Return the rates that are told apart, and how much of each weighing stands at each."""
        # the noise is even in samples, whatever their stamps say
        rate = np.abs(np.gradient(scan.phase_rad)) / (2.0 * np.pi * period)
        used = glance.record.valid
        edges = np.histogram_bin_edges(rate[used], _RATES)
        place = np.clip(np.searchsorted(edges, rate[used], side="right") - 1, 0, _RATES - 1)
        fade = bands.fade[used] ** 2
        counts = [np.bincount(place, share[used] * fade, _RATES) for share in shares()]
        return np.array([0.5 * (edges[1:] + edges[:-1]), *counts])

    rates, *counts = glance.record.remembered(("rates", scan.domain, *name), counted)
    nyquist = 0.5 / period
    grid = scan.transform.grid
    few = grid[:: max(1, len(grid) // _NORM_POINTS)]
    at = np.outer(rates, few)
    folded = np.abs((at + nyquist) % (2.0 * nyquist) - nyquist)
    norms = 0.5 * np.array(counts) @ np.interp(folded, places, seen, right=0.0)
    least = np.maximum(_LEAKS * norms.max(axis=1), 1e-300)
    rows = zip(norms, least, strict=True)
    return np.array([np.interp(grid, few, np.maximum(norm, low)) for norm, low in rows])


def scan_looks(fit: Fit, scans: tuple[Scan, ...], causes: Mapping[str, Cause]) -> list[Look]:
    """Return the strongest lines of every axis with the names that they may have."""
    found = []
    for scan in scans:
        statistic, _ = scan_power(fit, scan)
        peaks = _peaks(statistic, scan.dof)
        around = statistic
        if peaks:
            places = [float(scan.transform.grid[at]) for at in peaks]
            exact, without = _line_by_line(fit, scan, places)
            around = scan_power(fit, scan, without)[0]
            for at, place, value in zip(peaks, places, exact, strict=True):
                share = 1.0 / _noise_around(around, at, scan.dof)
                found += _named(scan, place, value, share, causes)
        if scan.whole:
            found += _whole_looks(fit, scan, around, causes)
    return found


def _whole_looks(
    fit: Fit, scan: Scan, around: FloatArray, causes: Mapping[str, Cause]
) -> list[Look]:
    """Return the strongest lines at whole orders that have one phase in all records of a stack."""
    sums, norms = _sums(fit, scan, whole=True)
    statistic = np.abs(np.sum(sums, axis=0)) ** 2 / np.sum(norms, axis=0)
    found = []
    kept = {name: w for name, c in causes.items() if (w := getattr(c, "whole", None)) is not None}
    for at in np.argsort(-statistic)[:_PEAKS]:
        if statistic[at] >= _LEAST_PEAK:
            order = float(scan.whole[0].grid[at])
            place = int(np.argmin(np.abs(scan.transform.grid - order)))
            share = 1.0 / _noise_around(around, place, scan.dof)
            found += _whole_names(order, float(statistic[at]), share, 2, kept)
    return found


def _peaks(statistic: FloatArray, dof: int) -> list[int]:
    """Return the points of the strongest lines, one in each hump."""
    left, width = statistic.copy(), _AROUND[0][1] * _PER_CELL
    peaks: list[int] = []
    for _ in range(_PEAKS):
        at = int(np.argmax(left))
        if left[at] < _LEAST_PEAK + dof - 2:
            break
        peaks.append(at)
        left[max(0, at - width) : at + width + 1] = 0.0
    return peaks


def _line_by_line(fit: Fit, scan: Scan, places: list[float]) -> tuple[list[float], FloatArray]:
    """Return the statistic of each line alone, and the residual without the strongest.

    Where the speed changes a line leaks along the axis, and is no noise there.
    """
    ends = np.cumsum([0, *(len(part.phase_rad) for part in scan.parts or (scan,))])
    columns = np.zeros((len(places), scan.dof, len(scan.phase_rad)))
    for own, place in zip(columns, places, strict=True):
        wave = _pair(place * scan.phase_rad).T
        for at, (a, b) in enumerate(pairwise(ends)):
            own[2 * at : 2 * at + 2, a:b] = wave[:, a:b]
    rows = fit.bands.transform(columns.reshape(-1, len(scan.phase_rad)).T)
    weight = fit.bands.spread(1.0 / fit.spectrum.power)
    alone, left = [], []
    for some in (waves := rows.reshape(len(places), scan.dof, -1)):
        white = some * weight
        right = white @ fit.residual
        amount = np.linalg.lstsq(white @ some.T, right, 1e-6)[0]
        alone.append(float(amount @ right))
        left.append(amount)
    most = int(np.argmax(alone))
    return alone, np.asarray(fit.residual - left[most] @ waves[most])


def _noise_around(statistic: FloatArray, at: int, dof: int) -> float:
    """Return the noise around a point relative to what is expected: a hump is no line."""
    found = [1.0]
    for first, last in _AROUND:
        near, far = first * _PER_CELL, last * _PER_CELL
        some = np.r_[
            statistic[max(0, at - far) : max(0, at - near)], statistic[at + near : at + far]
        ]
        if len(some) > far // 2:
            found.append(float(np.median(some)) / chi2_level(0.5, dof))
    return max(found)


def _look(
    cause: Cause | None, key: str, at: float, value: float, dof: int, trials: float, chance: float
) -> list[Look]:
    """Return a look at a line of this name; none where it cannot stand there."""
    if cause is None:
        return []
    bands = cause.shape[0].bands or ((cause.shape[0].lower, cause.shape[0].upper),)
    inside = any(a <= at <= b for a, b in bands)
    return [Look(Term(cause, {key: at}), value, dof, trials, chance)] if inside else []


def _known(value: float, share: float, dof: int, places: float) -> float:
    """Return the chance of a chi^2 this large at any of some known places."""
    tail = chi2_tail(value * share, dof)
    return float(any_of(tail, places))


def _whole_names(
    whole: float, value: float, share: float, dof: int, causes: Mapping[str, Cause]
) -> list[Look]:
    """Return the names that a line at a whole order may have."""
    known = float(_WHOLE_ORDERS) if whole <= _WHOLE_ORDERS else 2.0 * whole
    chance = _known(value, share, dof, known)
    out = _look(causes.get("ripple-harmonic"), "order", whole, value, dof, known, chance)
    for part in (1.0, 2.0, 3.0):
        if whole % part == 0.0:
            out += _look(causes.get("cogging"), "order", whole / part, value, dof, known, chance)
    return out


def _named(
    scan: Scan, place: float, value: float, share: float, causes: Mapping[str, Cause]
) -> list[Look]:
    """Return the names that a line at a place may have, with their false-alarm probabilities."""
    dof, cells = scan.dof, max(2.0, scan.density)
    free = _chance_anywhere(value * share, scan.density, dof)
    out: list[Look] = []

    def add(cause: Cause | None, key: str, at: float) -> None:
        out.extend(_look(cause, key, at, value, dof, cells, free))

    if scan.domain == "motor-order":
        whole = float(round(place))
        near = abs(place - whole) < 0.5 * scan.cell and whole >= 1.0
        if near and not scan.whole:
            out += _whole_names(whole, value, share, dof, causes)
        if not near or abs(place - whole) > 0.25 * scan.cell:
            add(causes.get("ripple-harmonic"), "order", place)
        for part in (1.0, 2.0, 3.0):
            add(causes.get("bearing-defect"), "order", place / part)
    elif scan.domain == "frequency":
        mains = causes.get("mains-hum")
        if mains is not None:
            known = max(2.0, sum(b - a for a, b in mains.shape[0].bands) / scan.cell)
            chance = _known(value, share, dof, known)
            out += _look(mains, "frequency_hz", place, value, dof, known, chance)
        add(causes.get("structural-tone"), "frequency_hz", place)
        if not out:
            add(causes.get(TONE_LINE.name, TONE_LINE), "frequency_hz", place)
    else:
        add(causes.get(OUTPUT_LINE.name, OUTPUT_LINE), "output_order", place)
    return out


def _chance_anywhere(value: float, density: float, dof: int) -> float:
    """Return the chance of a chi^2 this large anywhere on an axis (Davies 1987)."""
    crossings = density * (0.5 * value) ** (0.5 * (dof - 1)) * np.exp(-0.5 * value)
    return float(min(1.0, chi2_tail(value, dof) + crossings / gamma(0.5 * dof)))


def modulated_looks(fit: Fit, beside: Beside, scans: tuple[Scan, ...]) -> list[Look]:
    """Return, for each axis of lines and each other one, the best line with an envelope over it.

    None in a stack of records, each of which has an axis of its own.
    """
    scans = tuple(scan for scan in scans if scan.domain != "frequency" and not scan.parts)
    if not scans:
        return []
    (glance,) = glances(fit)
    weighted = fit.bands.inverse(glance.residual * fit.bands.spread(1.0 / glance.noise))
    weighted = np.where(fit.record.motion.valid, weighted, 0.0)
    axes = axes_of(fit.record)
    pairs = [(scan, axis) for scan in scans for axis in axes if scan.domain != axis.domain]
    found = []
    for scan, axis in pairs:
        count = _TURN_KNOTS if axis.period else _ENVELOPE_KNOTS
        hats = fit.record.remembered(("hats", axis.domain), partial(axis.hats, count))
        levels = axis.levels(count)
        waves = np.stack([scan.transform(weighted * hat) for hat in hats.T])
        mixes = [*levels, np.eye(hats.shape[1])]
        envelopes = [hats @ mix for mix in mixes]
        norms = line_norms(glance, scan, (axis.domain,), partial(_squares_of, envelopes))
        ends = np.cumsum([mix.shape[1] for mix in mixes])[:-1]
        tried = [
            (envelope, *_strongest(envelope, norm, mix.T @ waves))
            for envelope, norm, mix in zip(envelopes, np.split(norms, ends), mixes, strict=True)
        ]
        envelope, statistic, dof = max(tried, key=lambda one: one[1].max() - 4.0 * one[2])
        cause, places = _enveloped(scan, axis, hats, levels), max(2.0, scan.density)
        # a slow line is not what its cell says: beside the fit the best two are held anew
        near = [
            (*_line_beside(beside, scan, place, envelope), place)
            for place in _best_places(statistic, scan)
        ]
        value, dof, place = max(near)
        if not dof:
            continue
        chance = chi2_tail(value, dof) * places * len(pairs) * max(1.0, value / dof)
        term = Term(cause, {cause.shape[0].name: place})
        found.append(Look(term, value, dof, places, min(1.0, chance)))
    return found


def _squares_of(envelopes: list[FloatArray]) -> FloatArray:
    return np.hstack(envelopes).T ** 2


def _strongest(
    hats: FloatArray, norms: FloatArray, waves: NDArray[np.complexfloating]
) -> tuple[FloatArray, int]:
    """Return what envelopes explain of every line of a scan, and their directions."""
    unit = scaled(hats)[0]
    value, vector = np.linalg.eigh(unit.T @ unit)
    kept = value > SAME_SPACE * value[-1]
    apart = vector[:, kept] / np.sqrt(value[kept])
    statistic = np.sum(np.abs(apart.T @ (waves / np.sqrt(norms))) ** 2, axis=0)
    return statistic, 2 * apart.shape[1]


def _best_places(statistic: FloatArray, scan: Scan) -> list[float]:
    """Return the places of the two strongest lines, at a whole order where one is in the cell."""
    places = []
    left = statistic.copy()
    for _ in range(2):
        at = int(np.argmax(left))
        left[max(0, at - 2 * _PER_CELL) : at + 2 * _PER_CELL + 1] = 0.0
        place = float(scan.transform.grid[at])
        whole = round(place)
        near = abs(place - whole) < scan.cell and whole >= 1
        places.append(float(whole) if near else place)
    return places


def _line_beside(
    beside: Beside, scan: Scan, place: float, envelope: FloatArray
) -> tuple[float, int]:
    """Return the statistic of one line with an envelope beside a fit, and its directions."""
    wave = _pair(place * scan.phase_rad)
    rows, _ = scaled_rows(beside.bands, np.hstack([envelope * wave[:, :1], envelope * wave[:, 1:]]))
    return explained(*beside.projected(beside.products(rows)))


def _enveloped(scan: Scan, axis: Axis, hats: FloatArray, levels: list[FloatArray]) -> Cause:
    """Return a line with an envelope over an axis, as a cause without a name."""
    on_motor = scan.domain == "motor-order"
    place = _MOTOR_ORDER if on_motor else OUTPUT_LINE.shape[0]

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        angle = motion.angle_rad if on_motor else motion.output_angle_rad
        wave = _pair(shape[place.name] * angle)
        envelope = hats if len(motion) == len(hats) else np.ones((len(motion), hats.shape[1]))
        return np.hstack([envelope * wave[:, :1], envelope * wave[:, 1:]])

    knots = tuple(
        Parameter(f"knot_{k}_nm", "N m", -1e6, 1e6, "torque at one knot")
        for k in range(2 * hats.shape[1])
    )
    name = f"{TABLE}{scan.domain}*{axis.domain}"
    locked_to = "motor" if on_motor else "output"
    held = (name, "a line with an envelope", (place,), knots, locked_to, "", "", (), "", "")
    two = np.eye(2)
    subsets: list[FloatArray] = [np.asarray(np.kron(two, level), dtype=float) for level in levels]
    return Table(*held, columns, False, subsets=tuple(subsets))


def step_look(fit: Fit, cause: Cause) -> Look | None:
    """Return the best step of the zero at any sample of any record.

    References
    ----------
    .. [1] B. James, K. L. James, D. Siegmund, Biometrika 74 (1987) 71, doi:10.1093/biomet/74.1.71
       (largest of a step at any sample).
    """
    count = len(records_of(fit.record))
    if count == 1:
        return _step_look(fit, cause)
    looks = []
    for number in range(count):
        one, _ = piece_fit(fit, number)
        look = _step_look(one, cause)
        if look is None:
            continue
        begin = sum(len(record) for record in records_of(fit.record)[:number])
        shift = float(fit.record.motion.time_s[begin] - one.record.motion.time_s[0])
        time = look.term.shape["step_time_s"] + shift
        term = Term(cause, {"step_time_s": time})
        chance = min(1.0, count * look.false_alarm)
        looks.append(replace(look, term=term, trials=count * look.trials, false_alarm=chance))
    return max(looks, key=lambda look: look.statistic, default=None)


def _step_look(fit: Fit, cause: Cause) -> Look | None:
    record, bands = fit.record, fit.bands
    n = len(record)
    beside = fit.beside()
    margin = max(10, n // 50)
    places = np.linspace(margin, n - margin, _STEPS).astype(int)
    columns = (np.arange(n)[:, None] >= places[None, :]).astype(float)
    rows = bands.transform(columns - columns.mean(axis=0))
    norm = np.interp(np.arange(n), places, np.diag(beside.project(rows)[0]))

    # a torque that goes in steps all along has no zero that jumped: what stays when the few that a
    # record may have are taken out is the size of its usual steps, beside its noise
    residual, found = fit.residual, list[tuple[float, int]]()
    for _ in range(_FEW_STEPS + 1):
        weighted = bands.inverse(residual * beside.whitening)
        tail = np.cumsum(weighted[::-1])[::-1]
        tail -= float(weighted.sum()) * (1.0 - np.arange(n) / n)
        statistic = np.where(norm > 0.0, tail**2 / np.maximum(norm, 1e-300), 0.0)
        for _, other in (*found, (0.0, 0), (0.0, n)):
            statistic[max(0, other - margin // 2) : other + margin // 2] = 0.0
        at = int(np.argmax(statistic))
        if not statistic[at] > 0.0:
            return None
        row = bands.transform((np.arange(n) >= at).astype(float)[:, None] - (1.0 - at / n))[0]
        own = beside.unexplained(row)
        size = float(own @ (own * beside.whitening))
        found.append((float(tail[at] ** 2 / size), at))
        residual = residual - own * (tail[at] / size)
    (value, at), h = found[0], margin / 2.0 / n
    value /= 1.0 + max(0.0, found[-1][0] - 2.0 * float(np.log(n)))
    if value < 4.0:
        return None
    logs = 2.0 * np.log((1.0 - h) / h)
    density = np.sqrt(value / (2.0 * np.pi)) * ((1.0 - 1.0 / value) * logs + 4.0 / value)
    chance = float(min(1.0, np.exp(-0.5 * value) * density))
    time = float(record.motion.time_s[at])
    trials = max(1.0, chance / max(float(np.exp(-0.5 * value)), 1e-300))
    return Look(Term(cause, {"step_time_s": time}), value, 1, trials, chance)
