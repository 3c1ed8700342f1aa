"""Channel of the torque: the low-pass that it went through, and how late it was read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from hdbench.diagnosis.discovery.bands import Bands, LowPass, make_bands, smoothed
from hdbench.diagnosis.discovery.fit import SLOW, Fit
from hdbench.diagnosis.discovery.loudness import loudness
from hdbench.diagnosis.discovery.moments import solve
from hdbench.diagnosis.discovery.record import Record
from hdbench.diagnosis.discovery.term import Term
from hdbench.diagnosis.evidence import chi2_tail
from hdbench.model.motion import ACCELERATION_WINDOW_S
from hdbench.records.trace import FloatArray

# no torque is known better than to this share of its scatter
_FLOOR = 1e-3
# below this share of its scatter a torque that was filtered before it was stored holds nothing but
# the tail of the filter, which no model follows
_FILTERED_FLOOR = 2e-2
# a band with less than this many times the floor is empty
_EMPTY = 10.0
# corners of a low-pass that is tried where the torque has no power above some 0.3 of Nyquist,
# relative to the last frequency with power: what passes an older one is not seen far beyond it
_NARROW = 0.3
_CORNERS = np.geomspace(0.05, 1.5, 6)
# noise that falls below this share between this part of the band and its end may be low-passed
# too; in a record of less than so many samples that costs little to try
_FALLS, _FLAT, _SHORT = 0.3, 0.15, 40_000
# corners that are tried then, relative to Nyquist, the highest, and kinds that are tuned
_WIDE_CORNERS = np.geomspace(0.01, 0.8, 7)
_HIGHEST, _TUNED = 0.95, 2
# order of a low-pass, whether it has a delay, and whether it ran ahead of the sampling
# the first two tell whether there is one
_KINDS = (
    (2, False, False),
    (2, True, False),
    (4, False, False),
    (2, False, True),
    (2, True, True),
)
_FIRST = 2
# dry friction turns over within a hundredth of the largest speed
_SHARP = 100.0
# a low-pass is one of up to 70 that are tried, and is seldom: 25 to 1, 7.5 nats; one that takes
# noise off what is expected gains some nats more by chance
LOW_PASS_PRICE = 20.0
# name of a delay in the catalogue
DELAY = "time-skew"
# two channels of one log are seldom further apart than this, s; within it, delays from which the
# likelihood is followed: the first ripple that a delay turns by a whole turn is farther away
_LARGEST_S, _STARTS_S = 0.02, (-0.003, 0.003)
# an octave may speak against a delay by so many nats by chance, and all together by this share of
# what speaks for it, as no form is exact
_BY_CHANCE, _AGAINST = 2.0, 0.1
# a delay is followed where the parabola about the best start promises to gain more than this
_WORTH_NATS = 2.0


def start_fit(record: Record, known: Iterable[Term] = ()) -> Fit:
    """Return the fit of the baseline and the causes that the model already holds."""
    bands = make_bands(record.valid, record.period_s, taken_s=record.taken_s)
    # what it passes is its own, whatever the model expects
    stored = bands.transform(record.unloaded_nm[:, None], measured=True)[0]
    floor = (_FLOOR * float(np.std(record.response_nm[record.valid])) + 1e-12) ** 2
    power = bands.power(stored) / np.maximum(bands.counts, 1e-9)
    top = int(np.flatnonzero(power > _EMPTY * floor).max(initial=3))
    last = bands.frequency_hz[top] / bands.frequency_hz[-1]
    corners = _WIDE_CORNERS
    if last < _NARROW:
        floor *= (_FILTERED_FLOOR / _FLOOR) ** 2
        top = int(np.flatnonzero(power > _EMPTY * floor).max(initial=3))
        corners = np.minimum(_CORNERS * bands.frequency_hz[top] / bands.frequency_hz[-1], _HIGHEST)
        share = bands.edges[top + 1] / bands.length
        bands = make_bands(record.valid, record.period_s, float(share), record.taken_s)
    fit = Fit.begun(record, bands.low_passed(record.low_pass), floor, known)
    if record.channel_known or (corners is _WIDE_CORNERS and _is_open(fit)):
        return fit
    low_pass = _channel(record, bands, floor, corners)
    if low_pass is None:
        return fit
    return Fit.begun(record.behind(low_pass), bands.low_passed(low_pass), floor, known)


def _is_open(fit: Fit) -> bool:
    """Return whether the noise of a long record goes on to the end of the band."""
    bands = fit.bands
    left = bands.power(fit.residual) / np.maximum(bands.counts, 1e-9)
    share = bands.frequency_hz / bands.frequency_hz[-1]
    last = np.median(left[share > 1.0 - _FLAT])
    return bool(len(fit.record) > _SHORT and last > _FALLS * left[np.searchsorted(share, _FLAT)])


def _channel(record: Record, bands: Bands, floor: float, corners: FloatArray) -> LowPass | None:
    """Return the low-pass that a torque channel most likely has; None for none.

    Motion is explained by dry and viscous friction and an inertia, so that its own spectrum is not
    taken for the channel's.
    """
    motion = record.motion
    speed = np.where(motion.valid, motion.velocity_rad_s, 0.0)
    largest = max(float(np.abs(speed).max()), 1e-12)
    acceleration = np.where(motion.valid, motion.acceleration_rad_s2, 0.0)
    slow = np.column_stack([speed, np.tanh(_SHARP * speed / largest), acceleration])
    # no faster than an acceleration is known: a filter must gain nothing by taking their noise off
    share = min(1.0, record.period_s / ACCELERATION_WINDOW_S)
    slow = np.column_stack([smoothed(slow, share), acceleration])

    plain = Fit.begun(record.behind(None), bands, floor, ())
    plain.add(SLOW, slow)
    plain.settle(5)

    @cache
    def value(low_pass: LowPass | None) -> float:
        filtered = bands.low_passed(low_pass)
        fit = Fit.laid_out(record.behind(low_pass), filtered, floor, plain.spectrum)
        fit.add(SLOW, slow)
        # the second time from its own noise, so that the first one does not count
        for rounds in (3, 1):
            fit.take(solve(fit.moments(), fit.shapes, fit.spectrum, rounds=rounds))
        return fit.likelihood - (0.0 if low_pass is None else LOW_PASS_PRICE)

    loads = (False, True) if record.load != 0.0 else (False,)
    clocks = (False,) if bands.clock is None else (False, True)
    step, none = float(corners[1] / corners[0]), value(None)

    def nearest(kinds: Iterable[tuple[int, bool, bool]]) -> list[LowPass]:
        """Return the likeliest low-pass of each kind, to half a step between corners."""
        tried = [
            LowPass(c, order, causal, load, analog, over_time=timed)
            for order, causal, analog in kinds
            for load in loads
            for timed in clocks
            for c in corners
        ]
        return [
            _nearer(one, value, step) for one in _unlike(sorted(tried, key=value, reverse=True))
        ]

    nearer = nearest(_KINDS[:_FIRST])
    if max(map(value, nearer)) < none:
        return None
    nearer += nearest(_KINDS[_FIRST:])
    likely = sorted(nearer, key=value, reverse=True)[:_TUNED]
    best = max((_tuned(one, value, step) for one in likely), key=value)
    if best.causal:
        # a filter that runs once delays the torque, which a later reading does too
        none += max(best_delay(plain).evidence_nats, 0.0)
    return best if value(best) > none else None


def _unlike(ranked: Sequence[LowPass]) -> list[LowPass]:
    """Return the first low-pass of each kind."""
    found: dict[LowPass, LowPass] = {}
    for one in ranked:
        found.setdefault(replace(one, corner=1.0), one)
    return list(found.values())


def _moved(start: LowPass, factor: float) -> LowPass:
    """Return a low-pass with its corner moved."""
    return replace(start, corner=float(min(start.corner * factor, _HIGHEST)))


def _nearer(start: LowPass, value: Callable[[LowPass], float], step: float) -> LowPass:
    """Return a low-pass at the likeliest of three corners half a step apart."""
    return max((_moved(start, step**half) for half in (-0.5, 0.0, 0.5)), key=value)


def _tuned(start: LowPass, value: Callable[[LowPass], float], step: float) -> LowPass:
    """Return a low-pass at its likeliest corner between those that were tried beside it."""
    from scipy.optimize import minimize_scalar

    found = minimize_scalar(
        lambda ratio: -value(_moved(start, step**ratio)), bounds=(-0.5, 0.5), method="bounded",
        options={"xatol": 0.02},
    )  # fmt: skip
    return max((start, _moved(start, step**found.x)), key=value)


@dataclass(frozen=True, slots=True)
class Delay:
    """The likeliest delay of the torque channel.

    Parameters
    ----------
    fit : Fit
        The fit at that delay.
    gain_nats : float
        Log likelihood that it gains over none, less where the noise is loud that it explains.
    std_s : float
        Standard deviation of the delay, s.
    """

    fit: Fit
    gain_nats: float
    std_s: float

    @property
    def evidence_nats(self) -> float:
        """Gain less what one delay of all that may be costs, nats."""
        return self.gain_nats - float(np.log(max(self.trials, 1.0)))

    @property
    def trials(self) -> float:
        """Delays that can be told apart."""
        return 2.0 * _LARGEST_S / (float(np.sqrt(2.0 * np.pi)) * self.std_s)

    @property
    def false_alarm(self) -> float:
        """Probability of such a gain where there is no delay."""
        return min(1.0, chi2_tail(2.0 * max(self.gain_nats, 0.0), 1) * max(self.trials, 1.0))


def best_delay(fit: Fit) -> Delay:
    """Return the likeliest delay, the causes of a fit as they are."""
    from scipy.optimize import minimize_scalar

    @cache
    def at(late_s: float) -> float:
        return -fit.likelihood_of(late_s)

    def loss(late_s: float) -> float:
        return at(float(np.clip(late_s, -_LARGEST_S, _LARGEST_S)))

    here, step = fit.record.late_s, 0.5 * fit.record.period_s
    every = [0.0, here, *_STARTS_S]
    best = min(every, key=loss)
    slope, curve = _parabola(loss, best, step)
    if best != here or 0.5 * slope**2 > _WORTH_NATS * max(curve, 0.0):
        found = minimize_scalar(
            loss, bracket=(best - step, best + step), tol=0.01, options={"maxiter": 12}
        )
        best = min((*every, float(found.x)), key=loss)
        slope, curve = _parabola(loss, best, step)
    best = float(np.clip(best, -_LARGEST_S, _LARGEST_S))
    std = 1.0 / np.sqrt(max(curve, 1.0 / _LARGEST_S**2))
    late, gain = fit.retimed(best), loss(0.0) - loss(best)
    if gain > 0.0:
        none = fit.retimed(0.0)
        gain *= _of_all_octaves(none, late)
        torque = none.residual - late.residual
        gain /= loudness(fit.bands, torque, late.residual, late.spectrum.power)
    return Delay(late, gain, float(std))


def _of_all_octaves(none: Fit, late: Fit) -> bool:
    """Return whether no octave speaks against a delay: it is the same for all frequencies."""
    bands, power = late.bands, late.spectrum.power
    saved = 0.5 * (bands.power(none.residual) - bands.power(late.residual)) / power
    octave = np.log2(np.maximum(bands.frequency_hz / bands.frequency_hz[1], 1.0)).astype(int)
    nats = np.bincount(octave, saved)
    return float(-nats[nats < -_BY_CHANCE].sum()) < _AGAINST * float(nats[nats > 0.0].sum())


def _parabola(loss: Callable[[float], float], at: float, step: float) -> tuple[float, float]:
    """Return slope and curvature of a function about a place."""
    low, middle, high = loss(at - step), loss(at), loss(at + step)
    return (high - low) / (2.0 * step), (high + low - 2.0 * middle) / step**2
