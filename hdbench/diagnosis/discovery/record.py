"""One dynamic record as the diagnosis sees it: torque, motion, baseline and usable samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.acceleration import (
    ShownByAngle,
    fit_expected,
    in_step,
    likeliest,
    motions_of,
    ripple_of,
    seen_acceleration,
    seen_velocity,
    times_by_shaft,
)
from hdbench.diagnosis.discovery.bands import (
    SLOW_SHARE,
    LowPass,
    make_bands,
    shaped,
    smoothed,
)
from hdbench.diagnosis.discovery.baseline import BaselineChange
from hdbench.diagnosis.evidence import GAP
from hdbench.estimation.bandwidth import spectrum_of
from hdbench.model import BenchModel, Motion, baseline_columns, motion_from_trace
from hdbench.model.bench import expected_torque_nm
from hdbench.model.localfit import filled
from hdbench.model.motion import TORQUES, torque_from_trace
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

# name of the columns of a ripple whose lines were sampled too seldom to be followed
SAMPLED = "sampled-ripple"
# a pause of this share of the record's samples is no gap
_PAUSE = 0.02
# lines below the first of these places, relative to the Nyquist frequency, are taken as they are,
# and those between and above have an amplitude of their own, if this share of the turns is there; a
# spline through these follows filters of up to eighth order to a thousandth
_PLAIN_BELOW, _FEW = (0.3, 0.45, 0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.35), 0.01
# the misalignment of a bench that is clamped again may be this many times the model's
_MISALIGNED = 3.0
# the inertia of a profile is off by 30 % as a rule: half of the expected power is then there
_LEAST_POWER = 0.5
# a measured load of which the torque holds less than this share is none of it: a limit may hold
# more than half of it back, and what only follows a load may hold .15 (EMPS with load pulses)
_IN_TORQUE = 0.3
# a torque channel tells what it passes half of
_PASSED = 0.5
# share of the power of the angle that is the motion itself
_MOST_OF_ANGLE = 0.99
# memory of what is kept of a record, bytes: a search asks for most of it again
_KEPT = 1e8
# steps that scatter by less than this share of a period are even
_EVEN = 0.01


@dataclass(frozen=True, slots=True)
class Record:
    """A record ready for regression; arrays of shape (n_samples,).

    Parameters
    ----------
    motion : Motion
        Motion at every sample.
    torque_nm : ndarray
        Measured torque, N m; NaN where lost.
    valid : ndarray of bool
        Samples with torque and motion that are not masked.
    fixed_nm : ndarray
        What the baseline holds fixed, N m.
    names : tuple of str
        Baseline terms with free coefficients.
    columns : ndarray, shape (n_samples, n_names)
        Their columns.
    prior_nm : ndarray, shape (n_names,)
        Standard deviation of each coefficient beforehand, N m; infinite where free.
    period_s : float
        Median sampling period, s.
    load : float
        Coefficient of the measured load torque in `fixed_nm`.
    motion_passed : float
        Up to where the motion is known, relative to the Nyquist frequency.
    low_pass : LowPass or None
        Low-pass of the torque channel; None for none.
    channel_known : bool
        Whether `low_pass` was found already.
    clock_jitter : float
        Scatter of the time between samples that the shaft tells; 0 where the stamps are used.
    taken_s : ndarray or None
        When the samples were taken, s, by the shaft where it tells and else by the stamps, with
        pauses cut short; None where they are even.
    velocity_late_s : float
        Time by which the velocity was behind the angle before it was put in step, s.
    late_s : float
        Time by which the torque was read after the motion, s.
    late_known : bool
        Whether the model that was handed in already held it.
    records : tuple of Record
        Records of which this one is a stack; empty for one alone.
    added : ndarray of bool
        Samples that were not recorded: places on the clock in a gap of the stamps.
    referenced : bool
        Whether the motor angles of all records of a stack have one zero.
    logged_nm : ndarray or None
        Measured load times `load`, N m, where it was logged behind the low-pass of the torque.
    answer_rad_s2 : ndarray or None
        Acceleration that its channel hides and the torque tells; None once it is in the motion.
    made : dict
        What was formed last of its motion.
    """

    motion: Motion
    torque_nm: FloatArray
    valid: NDArray[np.bool_]
    fixed_nm: FloatArray
    names: tuple[str, ...]
    columns: FloatArray
    prior_nm: FloatArray
    period_s: float
    load: float
    motion_passed: float = 1.0
    clock_jitter: float = 0.0
    taken_s: FloatArray | None = None
    velocity_late_s: float = 0.0
    low_pass: LowPass | None = None
    channel_known: bool = False
    late_s: float = 0.0
    late_known: bool = False
    records: tuple[Record, ...] = ()
    added: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    referenced: bool = False
    logged_nm: FloatArray | None = None
    answer_rad_s2: FloatArray | None = None
    made: dict[object, FloatArray] = field(init=False, repr=False, default_factory=dict)

    def __len__(self) -> int:
        return len(self.valid)

    def remembered(self, key: object, make: Callable[[], FloatArray]) -> FloatArray:
        """Return what was made of the motion under this key, formed where it is not held."""
        values = self.made.pop(key, None)
        if values is None:
            values = make()
            values.setflags(write=False)
        self.made[key] = values
        while sum(one.nbytes for one in self.made.values()) > _KEPT:
            del self.made[next(iter(self.made))]
        return values

    @property
    def unloaded_nm(self) -> FloatArray:
        """Measured torque less the load as it was logged, N m, zero where not valid."""
        logged = self._held_load if self.logged_nm is None else self.logged_nm
        return np.where(self.valid, self.torque_nm - logged, 0.0)

    @property
    def response_nm(self) -> FloatArray:
        """Measured torque less what is fixed, N m, zero where not valid."""
        return np.where(self.valid, self.unloaded_nm - self.fixed_nm + self._held_load, 0.0)

    @property
    def _held_load(self) -> FloatArray:
        load = self.motion.load_torque_nm
        return np.zeros(len(self)) if load is None else np.asarray(self.load * load)

    def known_part(self, columns: FloatArray) -> FloatArray:
        """Return columns of a law of motion as far as the motion of each record is known."""
        pieces = self.records or (self,)
        ends = np.cumsum([len(one) for one in pieces])[:-1]
        return np.concatenate(
            [
                smoothed(part, one.motion_passed) if one.motion_passed < 1.0 else part
                for one, part in zip(pieces, np.split(columns, ends), strict=True)
            ]
        )

    @property
    def ahead_nm(self) -> FloatArray:
        """The fixed torque that goes through the torque channel, N m; 0 where it is unknown.

        A load that was logged behind the same filter does not go through it again.
        """
        load = self.motion.load_torque_nm
        logged = 0.0 if self.logged_nm is None or load is None else self.load * load
        return np.asarray(np.nan_to_num(self.fixed_nm - logged))

    def behind(self, low_pass: LowPass | None) -> Record:
        """Return the record with a torque channel behind a low-pass.

        Where the measured load was logged behind the same filter, causes act on what the filter was
        undone of; the load itself stands in the torque as it was logged.
        """
        found = replace(self, low_pass=low_pass, channel_known=True)
        load = self.motion.load_torque_nm
        if low_pass is None or not low_pass.load or load is None:
            return found
        smooth = self.motion.load_smooth_nm
        sharp = low_pass.undone(load)
        motion = replace(
            self.motion,
            load_torque_nm=sharp,
            load_smooth_nm=None if smooth is None else low_pass.undone(smooth),
        )
        fixed = self.fixed_nm + self.load * (sharp - load)
        return replace(found, motion=motion, fixed_nm=fixed, logged_nm=self.load * load)

    @property
    def span_s(self) -> float:
        """Duration, s."""
        return float(self.motion.time_s[-1] - self.motion.time_s[0])


def on_clock(
    trace: Trace, masked: NDArray[np.bool_]
) -> tuple[Trace, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return a trace whose motion is there at every tick, what takes no part, and what was added.

    A filter and a delay go on through gaps of the stamps and lost samples: the motion there is
    interpolated, and the torque takes no part. A pause of more than a fiftieth of the record stays.
    """
    time = trace.time_s
    steps = np.diff(time) / np.median(np.diff(time))
    gap = (steps > GAP) & (steps < _PAUSE * len(time))
    counts = np.where(gap, np.round(steps).astype(int) - 1, 0)
    places = np.arange(len(time)) + np.concatenate([[0], np.cumsum(counts)])
    added = np.ones(places[-1] + 1, dtype=bool)
    added[places] = False
    ticks = np.interp(np.arange(len(added)), places, time)
    columns, lost = {"time_s": ticks}, added.copy()
    for name in (n for n in trace.columns if n != "time_s"):
        columns[name] = np.full(len(added), np.nan)
        columns[name][places] = trace[name]
        if name not in TORQUES:
            gone = ~np.isfinite(columns[name])
            lost |= gone
            columns[name] = filled(ticks, columns[name], gone)
    lost[places] |= masked
    return replace(trace, columns=columns), lost, added


def prepare_record(
    trace: Trace,
    profile: ProfileData,
    model: BenchModel,
    masked: NDArray[np.bool_],
    change: BaselineChange | None = None,
) -> Record:
    """Return the record with its baseline.

    Notes
    -----
    On less than an output turn the torque once per turn is expected near the model's: its
    correction has a prior of three times the model's amplitude.

    An angle that is integrated from the velocity by the contract's rule lies half a sample behind
    the shaft wherever the speed changes, a velocity channel may be smoothed or late, and a logger
    may stamp evenly what it sampled unevenly. Where the torque is likelier with the half sample put
    back, the acceleration by the measured angle, or the time between samples by what the shaft
    turned, that is used.
    """
    torque = torque_from_trace(trace, profile)
    change = change or BaselineChange()
    motion, velocity_late = in_step(motion_from_trace(trace, profile))
    period = float(np.median(np.diff(motion.time_s)))
    read = motion.valid & np.isfinite(torque)
    usable = read & ~masked
    # a bridge over what is masked would be faster than the channel
    passed = _passed(motion.velocity_rad_s, torque, read, period)
    motions = [(one, np.zeros(len(torque)), 0.0) for one in motions_of(motion)]
    clocks = [(motion.time_s, 0.0)]
    if "expected-torque" not in change.without and passed == 1.0:
        clocks.append(times_by_shaft(motion))
        ripple = ripple_of(motion, profile, torque, usable)
        motions = [
            (replace(found, time_s=motion.time_s), answer, jitter)
            for (one, *_), (time, jitter) in product(motions, clocks)
            for found, answer in [seen_acceleration(replace(one, time_s=time), ripple, period)]
        ]
    motion, answer, jitter = likeliest(motions, profile, torque, usable, period)
    motion = seen_velocity(motion, period)
    load = 0.0 if "load" in change.without else _load_share(motion, profile, torque, masked)
    fixed, names, columns = baseline_columns(motion, profile, load=load)
    whole_turn = "misalignment:cosine" in names
    fixed, names, columns = change.apply(motion, fixed, names, columns)
    names, columns = _sampled_lines(motion, period, names, columns)
    prior = np.full(len(names), np.inf)
    if not whole_turn and "misalignment" not in change.without:
        amplitude, phase = model.misalignment
        fixed = fixed + amplitude * np.cos(motion.output_angle_rad + phase)
        once = [np.cos(motion.output_angle_rad), np.sin(motion.output_angle_rad)]
        columns = np.column_stack([columns, *once])
        names = (*names, "misalignment:cosine", "misalignment:sine")
        size = max(_MISALIGNED * amplitude, 1e-6 * profile.drive.rated_torque_nm)
        prior = np.append(prior, [size, size])
    valid = motion.valid & np.isfinite(torque) & np.isfinite(fixed) & ~masked
    valid &= np.isfinite(columns).all(axis=1)
    starts = np.concatenate([[True], np.diff(motion.time_s) > GAP * period])
    if passed < 1.0:
        fixed = smoothed(fixed[:, None], passed)[:, 0]
    return Record(
        replace(motion, starts=starts),
        torque,
        valid,
        fixed,
        names,
        np.where(np.isfinite(columns), columns, 0.0),
        prior,
        period,
        load,
        motion_passed=passed,
        clock_jitter=jitter,
        taken_s=_uneven(clocks[-1][0], period),
        velocity_late_s=velocity_late,
        answer_rad_s2=answer,
    )


def _uneven(time_s: FloatArray, period_s: float) -> FloatArray | None:
    """Return times of samples with pauses cut short; None where they are even."""
    steps = np.diff(time_s)
    if float(np.std(steps)) < _EVEN * period_s:
        return None
    pause = steps > _PAUSE * len(time_s) * period_s
    return np.concatenate([[0.0], np.cumsum(np.where(pause, period_s, steps))])


def _passed(
    velocity: FloatArray, torque: FloatArray, valid: NDArray[np.bool_], period_s: float
) -> float:
    """Return up to where the motion is known beside the torque, relative to Nyquist; 1 for all.

    A velocity that was smoothed before it was stored holds little of its upper octave. Where the
    torque was smoothed too, its own low-pass says all.
    """
    limits = []
    for values in (velocity, torque):
        held = np.where(valid, values, np.nan)
        steps = np.abs(np.diff(held))
        step = float(np.min(steps[np.isfinite(steps) & (steps > 0.0)], initial=np.inf))
        found = spectrum_of(held, 1.0 / period_s, step)
        limits.append(None if found is None or found.computed else found.limit_hz)
    if limits[0] is None or limits[1] is not None:
        return 1.0
    return float(limits[0] * period_s)


def as_followed(record: Record) -> Record:
    """Return a record whose acceleration is no faster than the torque can follow.

    A coarse or noisy channel that is differentiated adds what grows with frequency, and above a
    resonance the load no longer turns with the motor. Where more is expected than twice the power
    that the torque has, that is none of the load's, and neither is what the motion hides. Where
    that is so of the motion itself, the inertia is wrong, and the acceleration stays.
    """
    motion, output = record.motion, record.motion.output_angle_rad
    bands = make_bands(record.valid, record.period_s, taken_s=record.taken_s).low_passed(
        record.low_pass
    )
    expected = expected_torque_nm(motion, motion.inertia_nm_s2)
    speed = motion.velocity_rad_s
    friction = (speed, np.sign(speed))
    others = np.column_stack(
        [motion.angle_rad, *friction, np.cos(output), np.sin(output), expected]
    )
    others = np.where(motion.valid[:, None], others, 0.0)
    own = bands.transform((record.response_nm + others[:, -1])[:, None], measured=True)[0]
    angle, *rows, asked = bands.transform(others)
    turns = bands.power(angle)
    # gravity may cancel the load of the motion itself, and a ripple that of a speed that it moves:
    # they are taken out beside that
    most = int(np.searchsorted(np.cumsum(turns), _MOST_OF_ANGLE * turns.sum()))
    slow = np.where(np.arange(bands.size) < bands.edges[most + 1], asked, 0.0)
    columns = np.array([*bands.transform(record.columns), angle, *rows])
    found = fit_expected(bands, own, columns, np.array([asked - slow, slow]))
    places = 2.0 * record.period_s * bands.frequency_hz
    # narrow bands have little power by chance, and what a low-pass holds back is told by nothing
    told = (places > SLOW_SHARE) & (bands.passed[bands.edges[:-1]] > _PASSED)
    missing = told & (found.has < _LEAST_POWER * found.asks)
    kept = np.where(np.logical_or.accumulate(missing), 0.0, 1.0)
    acceleration, shown = motion.acceleration_rad_s2, motion.shown_by_angle
    if kept.min() < 1.0 and float(turns @ kept) > 0.5 * float(turns.sum()):
        acceleration = shaped(acceleration[:, None], (places, kept))[:, 0]
        if isinstance(shown, ShownByAngle):
            shown = replace(shown, gain=(places, kept))
    elif record.answer_rad_s2 is not None:
        acceleration = acceleration + record.answer_rad_s2
    new = replace(motion, acceleration_rad_s2=acceleration, shown_by_angle=shown)
    change = expected_torque_nm(new, motion.inertia_nm_s2) - expected
    return replace(record, motion=new, fixed_nm=record.fixed_nm + change, answer_rad_s2=None)


def _sampled_lines(
    motion: Motion, period_s: float, names: tuple[str, ...], columns: FloatArray
) -> tuple[tuple[str, ...], FloatArray]:
    """Return names and columns where lines near and above the Nyquist frequency stand apart.

    What of such a line is in the record is up to filters before the converter: its amplitude there
    is free, interpolated between a few frequencies.
    """
    from scipy.interpolate import CubicSpline

    speed = np.where(motion.valid, np.abs(motion.velocity_rad_s), 0.0)
    spline = CubicSpline(_PLAIN_BELOW, np.eye(len(_PLAIN_BELOW)), bc_type="clamped")
    more, parts, columns = names, [], columns.copy()
    for place in [i for i, n in enumerate(names) if n.startswith("ripple:") and "cos" in n]:
        order = float(names[place].split(":")[1])
        of_nyquist = order * speed * period_s / np.pi
        turned = speed / max(float(speed.sum()), 1e-12)
        above, plain = turned[of_nyquist > 1.0].sum(), turned[of_nyquist < _PLAIN_BELOW[0]].sum()
        if above < _FEW or plain < _FEW:
            continue
        pair = columns[:, place : place + 2]
        weights = spline(np.clip(of_nyquist, _PLAIN_BELOW[0], _PLAIN_BELOW[-1])).T
        for k, weight in enumerate(weights[1:], 1):
            parts.append(pair * weight[:, None])
            more += tuple(f"{SAMPLED}:{order!r}:{part}_{k}" for part in ("cosine", "sine"))
        columns[:, place : place + 2] = pair * weights[0][:, None]
    return more, np.hstack([columns, *parts])


def _load_share(
    motion: Motion, profile: ProfileData, torque: FloatArray, masked: NDArray[np.bool_]
) -> float:
    """Return 1, 0 or -1: whether the measured load is in the torque, and with which sign."""
    if motion.load_torque_nm is None:
        return 1.0
    usable = motion.valid & np.isfinite(torque) & np.isfinite(motion.load_torque_nm) & ~masked
    load = motion.load_torque_nm[usable]
    fixed, _, columns = baseline_columns(motion, profile, load=0.0)
    speed = motion.velocity_rad_s[usable]
    design = np.column_stack([load, columns[usable], speed, np.sign(speed)])
    if not len(load) >= design.shape[1] or not float(np.abs(load).max()) > 0.0:
        return 1.0
    share = np.linalg.lstsq(design, (torque - fixed)[usable], rcond=None)[0][0]
    return float(np.sign(share)) if abs(share) > _IN_TORQUE else 0.0


def with_simulated(
    record: Record, fitted_nm: FloatArray, slope_nm_per_rad: FloatArray, error_rad: FloatArray
) -> Record:
    """Return the record with a simulated torque, for causes that act on all of it."""
    motion = replace(
        record.motion,
        simulated_nm=record.fixed_nm + fitted_nm,
        ripple_slope_nm_per_rad=slope_nm_per_rad,
        angle_error_rad=error_rad,
    )
    return replace(record, motion=motion)
