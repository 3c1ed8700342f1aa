"""The motion that a torque follows: by which channel and clock, and with what acceleration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.bands import Bands, make_bands, mirrored_lines, shaped
from hdbench.estimation.delay import delay_of
from hdbench.model import Motion, baseline_columns
from hdbench.model.bench import expected_torque_nm
from hdbench.model.motion import angle_curvature
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

# a sample is at least this share of a step after the one before: one that was held has no time
_LEAST_STEP = 0.05
# bands of frequency in which steps of a clock have the same power, but for so many standard
# deviations between two of them
_CLOCK_BANDS, _BY_CHANCE = 8, 3.0
# rounds in which weights follow what they leave; share of a scatter that one of them leaves
_ROUNDS, _QUIETEST = 4, 1e-3
# cells of a short-time spectrum: so long, of so many samples at least, and motion where the mean of
# nine has so many times the power of the noise
_CELL_S, _LEAST_CELL, _STANDS_OUT = 0.2, 32, 5.0
# the square of a sum of products without a common part is above so many times that of their squares
# once in a hundred, where three quarters of a cell are in the next
_AGREE = 9.0
# an angle jumps where it parts from the velocity by so many times what 99 of 100 samples do
_JUMPS = 3.0
# a velocity is late by what is more than a sample by so many standard deviations
_SURE = 5.0
# a drive answers alike to frequencies within so many octaves
_ALIKE = 0.25


def times_by_shaft(motion: Motion) -> tuple[FloatArray, float]:
    """Return when samples were taken by what the shaft turned between them, s.

    And the scatter of the steps between them relative to those of the stamps.

    Between two samples the angle moves by the speed times the time: what of the difference grows
    with the speed is no noise of either channel, but time that the stamps do not show. Steps of a
    clock do not know of each other: what has more power below than at the highest frequencies is
    an error of the angle, or motion that the velocity does not show.
    """
    from scipy.optimize import nnls

    steps, velocity = np.diff(motion.time_s), motion.velocity_rad_s
    moves, turned = np.diff(motion.angle_rad), 0.5 * (velocity[1:] + velocity[:-1]) * steps
    good = np.isfinite(moves + turned)
    if not np.any(turned[good]):
        return motion.time_s, 0.0
    moves, turned = np.where(good, moves, 0.0), np.where(good, turned, 0.0)
    turned = turned * float(moves @ turned) / max(float(turned @ turned), 1e-300)
    left, speed = moves - turned, turned**2
    # both amounts of the scatter weighted by what they make together, from equal shares on
    amounts = np.mean(left[good] ** 2) * np.array([0.5, 0.5 / max(speed[good].mean(), 1e-300)])
    for _ in range(_ROUNDS):
        scatter = amounts[0] + amounts[1] * speed[good]
        design = np.column_stack([np.ones(len(scatter)), speed[good]]) / scatter[:, None]
        amounts = nnls(design, left[good] ** 2 / scatter)[0] + _QUIETEST * amounts
    noise, jitter = amounts
    lines = np.fft.rfft(jitter * turned * left / (jitter * speed + noise))
    edges = np.unique(np.linspace(0, len(lines), _CLOCK_BANDS + 1).astype(int))
    counts = np.diff(edges)
    power = np.add.reduceat(np.abs(lines) ** 2, edges[:-1]) / counts
    # no shaft moves in the last band; a mean of so many exponentials scatters by one over the root
    # of their number
    most = power[-1] * (1.0 + _BY_CHANCE / np.sqrt(counts))
    lines *= np.repeat(np.minimum(1.0, most / np.maximum(power, 1e-300)), counts)
    told = np.maximum(1.0 + np.fft.irfft(lines, len(steps)), _LEAST_STEP)
    ticks = motion.time_s[0] + np.concatenate([[0.0], np.cumsum(steps * told)])
    return ticks, float(np.std(told))


def in_step(motion: Motion) -> tuple[Motion, float]:
    """Return the motion with a velocity in step with a measured angle, and how late it was, s.

    A drive's own filter makes its velocity late, which the phase between the two tells. What is
    less than a sample stays.
    """
    time, period_s = motion.time_s, float(np.median(np.diff(motion.time_s)))
    if motion.angle_source == "velocity":
        return motion, 0.0
    rate = np.gradient(motion.angle_rad, time)
    off = np.abs(rate - motion.velocity_rad_s)
    if np.isfinite(off).any():
        # an angle that jumps, as where samples were lost, says nothing of a delay
        rate = np.where(off > _JUMPS * np.nanquantile(off, 0.99), np.nan, rate)
    told = delay_of(motion.velocity_rad_s, rate, period_s)
    if told is None or abs(told[0]) - _SURE * told[1] < period_s:
        return motion, 0.0
    known = motion.valid

    def earlier(values: FloatArray) -> FloatArray:
        return np.where(known, np.interp(time + told[0], time[known], values[known]), np.nan)

    moved = replace(motion, velocity_rad_s=earlier(motion.velocity_rad_s))
    # an acceleration by the angle is in step already
    if motion.acceleration_source != "angle":
        moved = replace(moved, acceleration_rad_s2=earlier(motion.acceleration_rad_s2))
    return moved, told[0]


def motions_of(motion: Motion) -> tuple[Motion, ...]:
    """Return the motion as it is, and with an angle in step or an acceleration by the angle."""
    if motion.acceleration_source == "angle":
        return (motion,)
    if motion.angle_source != "velocity":
        by_angle = angle_curvature(motion.time_s, motion.angle_rad)
        return motion, replace(motion, acceleration_rad_s2=by_angle, acceleration_source="angle")
    velocity = np.where(motion.valid, motion.velocity_rad_s, 0.0)
    half = 0.5 * float(np.median(np.diff(motion.time_s))) * (velocity - velocity[0])
    output = half / motion.gear_ratio if motion.output_source == "motor" else 0.0
    moved = replace(motion, angle_rad=motion.angle_rad + half)
    return motion, replace(moved, output_angle_rad=motion.output_angle_rad + output)


@dataclass(frozen=True, slots=True)
class Derivative:
    """Derivative of a measured motion at even times, in cells of a short-time spectrum.

    Parameters
    ----------
    time_s : ndarray, shape (n_samples,)
        When the samples were taken, s.
    period_s : float
        Sampling period, s.
    degree : int
        2 for the acceleration by an angle, 1 for that by a velocity, 0 for the velocity itself.
    """

    time_s: FloatArray
    period_s: float
    degree: int

    @property
    def ticks_s(self) -> FloatArray:
        """Even times, s."""
        count = round((self.time_s[-1] - self.time_s[0]) / self.period_s) + 1
        return np.asarray(self.time_s[0] + self.period_s * np.arange(count))

    def has_cells(self, values: FloatArray) -> bool:
        """Return whether a channel is long enough, and has no pauses as long as it is."""
        long = np.isfinite(values).sum() >= 2 * _LEAST_CELL
        return bool(long and len(self.ticks_s) <= 2 * len(self.time_s))

    @property
    def _width(self) -> int:
        """Samples of a cell, of which three quarters are in the next."""
        return min(max(_LEAST_CELL, round(_CELL_S / self.period_s)), len(self.ticks_s) // 2)

    def of(self, values: FloatArray) -> FloatArray:
        """Return the derivative of a channel, which may have lost samples, at the even times."""
        from scipy.interpolate import Akima1DInterpolator

        known = np.isfinite(values)
        at = Akima1DInterpolator(
            self.time_s[known], values[known], method="makima", extrapolate=True
        )
        return _derivative(at(self.ticks_s), self.period_s, self.degree)

    def cells(self, values: FloatArray) -> tuple[FloatArray, NDArray[np.complex128]]:
        """Return the frequencies of the cells, Hz, and what they hold of values at even times."""
        from scipy.signal import stft

        # cells at the ends are cut: they lie outside
        width = self._width
        padded, rate = np.pad(values, width, mode="edge"), 1.0 / self.period_s
        hertz, _, cells = stft(padded, rate, nperseg=width, noverlap=3 * width // 4)
        return hertz, cells

    def of_cells(self, cells: NDArray[np.complex128]) -> FloatArray:
        """Return what cells hold, at the samples."""
        from scipy.signal import istft

        width, ticks = self._width, self.ticks_s
        made = istft(cells, 1.0 / self.period_s, nperseg=width, noverlap=3 * width // 4)[1]
        return np.asarray(np.interp(self.time_s, ticks, made[width : width + len(ticks)]))


@dataclass(frozen=True, slots=True)
class ShownByAngle:
    """What the acceleration of a record shows of an error of the angle.

    Parameters
    ----------
    derivative : Derivative
        How the acceleration was made.
    kept : ndarray of bool
        Cells that stood out of the noise.
    gain : tuple of ndarray or None
        Gain at frequencies relative to Nyquist's that it was given afterwards.
    """

    derivative: Derivative
    kept: NDArray[np.bool_]
    gain: tuple[FloatArray, FloatArray] | None = None

    def __call__(self, error_rad: FloatArray) -> FloatArray:
        """Return what an error of the angle, rad, adds to the acceleration, rad/s^2."""
        made, values = self.derivative, error_rad
        if made.degree == 1:
            # a velocity by differences has the error of the angle
            values = np.gradient(values, made.time_s)
        shown = made.of_cells(np.where(self.kept, made.cells(made.of(values))[1], 0.0))
        return shown if self.gain is None else shaped(shown[:, None], self.gain)[:, 0]


def seen_acceleration(
    motion: Motion, ripple_nm: FloatArray, period_s: float
) -> tuple[Motion, FloatArray]:
    """Return the motion with its acceleration as far as that stands out of its channel's noise.

    And how the speed answers to the ripple in the rest, rad/s^2. The motion itself where it is too
    short, or has pauses as long as it is.
    """
    degree = 2 if motion.acceleration_source == "angle" else 1
    values = motion.angle_rad if degree == 2 else motion.velocity_rad_s
    made = Derivative(motion.time_s, period_s, degree)
    if not made.has_cells(values):
        return motion, np.zeros(len(motion))
    hertz, cells = made.cells(made.of(values))
    kept = _standing_out(hertz, cells, made.degree, _step_of(values))
    asked = made.cells(np.interp(made.ticks_s, motion.time_s, ripple_nm))[1]
    answer = _answer(hertz, cells, np.where(kept, 0.0, asked), made.degree)
    seen = made.of_cells(np.where(kept, cells, 0.0))
    found = replace(motion, acceleration_rad_s2=seen, shown_by_angle=ShownByAngle(made, kept))
    return found, made.of_cells(answer)


def seen_velocity(motion: Motion, period_s: float) -> Motion:
    """Return the motion with its velocity as far as that stands out of its channel's noise.

    Near standstill a dry friction follows every change of sign, that of noise too.
    """
    values, made = motion.velocity_rad_s, Derivative(motion.time_s, period_s, 0)
    if not made.has_cells(values):
        return motion
    hertz, cells = made.cells(made.of(values))
    kept = _standing_out(hertz, cells, made.degree, _step_of(values))
    seen = made.of_cells(np.where(kept, cells, 0.0))
    return replace(motion, velocity_rad_s=np.where(np.isfinite(values), seen, np.nan))


def _step_of(values: FloatArray) -> float:
    """Return the step in which values were counted; 0 where they were not."""
    values = values[np.isfinite(values)]
    turns = np.abs(np.diff(values, 2))
    # rounding is far below a step, and few samples are interpolated
    turns = turns[turns > 1e-12 * np.abs(values).max()]
    if not len(turns):
        return 0.0
    step = float(np.quantile(turns, 0.1))
    beside = np.abs(turns - step * np.round(turns / step))
    # a fifth is within a tenth of a whole number by chance
    return step if float(np.mean(beside < 0.1 * step)) > 0.5 else 0.0


def _standing_out(
    hertz: FloatArray, seen: NDArray[np.complex128], degree: int, step: float
) -> NDArray[np.bool_]:
    """Return where a derivative of the measured motion stands out of its channel's noise.

    A cell of the short-time spectrum takes part where it stands out of the noise, which is even
    over the frequencies of what was differentiated: a line that the speed moves is kept, the noise
    beside it is not. Counting steps make lines, as steady as the speed: the first of their sawtooth
    has an amplitude of the step over pi, and no line below that takes part.
    """
    from scipy.ndimage import uniform_filter

    level = _level(hertz, degree)
    # the median of the upper octave: lines stand in few cells; that of an exponential is ln 2
    noise = float(np.median((np.abs(seen) ** 2 / level)[hertz > 0.5 * hertz[-1]])) / np.log(2.0)
    # a line stands in three cells of a Hann window, a half of its power in their mean; between two
    # cells, or with the next harmonic beside it, it may have twice that
    counted = 2.0 * 0.5 * (0.5 * step / np.pi * (2.0 * np.pi) ** degree) ** 2
    least = max(_STANDS_OUT * noise, counted)
    return np.asarray(uniform_filter(np.abs(seen) ** 2 / level, 3) > least)


def _answer(
    hertz: FloatArray,
    seen: NDArray[np.complex128],
    asked: NDArray[np.complex128],
    degree: int,
) -> NDArray[np.complex128]:
    """Return how a derivative of the motion answers to a torque, where the cells agree on that.

    The speed of a drive answers to its torque: what no cell shows by itself many may say together.
    """
    # the noise grows with the frequency
    level = _level(hertz, degree)
    both = seen * asked.conj() / level
    octave = np.log2(np.maximum(hertz, hertz[1]))
    beside = np.abs(octave - octave[:, None]) < _ALIKE
    agreed, asks = (beside @ one.sum(axis=1) for one in (both, np.abs(asked) ** 2 / level))
    answers = np.abs(agreed) ** 2 > _AGREE * (beside @ (np.abs(both) ** 2).sum(axis=1))
    shares = np.where(answers, agreed, 0.0) / np.maximum(asks, 1e-300)
    return np.asarray(asked * shares[:, None])


def _level(hertz: FloatArray, degree: int) -> FloatArray:
    """Return the power of a derivative of even noise at some frequencies, as a column."""
    return np.asarray(np.maximum(hertz, hertz[1])[:, None] ** (2 * degree))


def _derivative(values: FloatArray, period_s: float, degree: int) -> FloatArray:
    """Return the derivative of a measured motion by its spectrum."""
    from scipy.interpolate import CubicHermiteSpline

    n = len(values)
    # less a cubic with the same values and slopes at both ends, so that the mirrored ends meet
    slopes = [np.diff(values[:9]).mean(), np.diff(values[-9:]).mean()]
    ends = CubicHermiteSpline([0.0, n - 1.0], values[[0, -1]], slopes)
    lines = mirrored_lines(values - ends(np.arange(n)))
    whole = len(lines) - 1
    turn = 2j * np.pi * np.arange(len(lines)) / (2.0 * whole * period_s)
    made = np.fft.irfft(lines * turn**degree, 2 * whole)[:n]
    return np.asarray(made + ends(np.arange(n), degree) / period_s**degree)


def ripple_of(
    motion: Motion, profile: ProfileData, torque: FloatArray, usable: NDArray[np.bool_]
) -> FloatArray:
    """Return the baseline of a torque beside friction, N m; 0 where the motion is unknown."""
    rows = _beside_friction(motion, profile, torque)
    # between the torque and both frictions with what is expected
    columns = rows[:, 1:-3]
    usable = usable & np.isfinite(rows).all(axis=1)
    if usable.sum() <= rows.shape[1]:
        return np.zeros(len(torque))
    amounts = _fitted(rows, usable, float(np.median(np.diff(motion.time_s)))).amounts
    return np.asarray(np.nan_to_num(columns) @ amounts[: columns.shape[1]])


def likeliest(
    motions: list[tuple[Motion, FloatArray, float]],
    profile: ProfileData,
    torque: FloatArray,
    usable: NDArray[np.bool_],
    period_s: float,
) -> tuple[Motion, FloatArray, float]:
    """Return the motion beside which baseline and friction make the torque most likely.

    As a channel may hold back what is fast, the torque may have any share of the expected torque
    at a frequency.
    """
    asked = [_beside_friction(motion, profile, torque) for motion, *_ in motions]
    usable = usable & np.all([np.isfinite(rows).all(axis=1) for rows in asked], axis=0)
    if len(motions) == 1 or usable.sum() <= asked[0].shape[1]:
        return motions[0]
    unlikely = [_fitted(rows, usable, period_s).unlikeliness for rows in asked]
    return motions[int(np.argmin(unlikely))]


def _beside_friction(motion: Motion, profile: ProfileData, torque: FloatArray) -> FloatArray:
    """Return the torque, what acts on it everywhere, and the expected torque, as columns."""
    fixed, _, columns = baseline_columns(motion, profile)
    expected = expected_torque_nm(motion, motion.inertia_nm_s2)
    speed = motion.velocity_rad_s
    return np.column_stack([torque - fixed + expected, columns, speed, np.sign(speed), expected])


def _fitted(rows: FloatArray, usable: NDArray[np.bool_], period_s: float) -> ExpectedFit:
    bands = make_bands(usable, period_s)
    own, *columns, expected = bands.transform(np.where(usable[:, None], rows, 0.0))
    return fit_expected(bands, own, np.array(columns), expected[None, :])


@dataclass(frozen=True, slots=True)
class ExpectedFit:
    """How well an expected torque fits in each band, beside what acts everywhere.

    The power that the torque has beside the rest, that of the expected torque, the amounts of the
    rest, and twice the unlikeliness in any noise (Whittle) with the share that fits best,
    beforehand 1(1).
    """

    has: FloatArray
    asks: FloatArray
    amounts: FloatArray
    unlikeliness: float


def fit_expected(
    bands: Bands, own: FloatArray, columns: FloatArray, parts: FloatArray
) -> ExpectedFit:
    """Return how well a sum of rows fits another in each band."""
    asked, power = parts.sum(axis=0), np.ones(len(bands))
    asks = bands.power(asked)
    for _ in range(_ROUNDS):
        weight = bands.spread(power) ** -0.5
        design = np.vstack([columns, parts]) * weight
        amounts = np.linalg.lstsq(design.T, own * weight, rcond=None)[0][: len(columns)]
        rest = own - amounts @ columns
        variance = 1.0 / (1.0 + asks / power)
        both = np.add.reduceat(rest * asked, bands.edges[:-1])
        share = variance * (1.0 + both / power)
        left = bands.power(rest - bands.spread(share) * asked) + variance * asks
        power = np.maximum(left / bands.counts, 1e-300)
    unlikely = bands.counts * np.log(power) + (share - 1.0) ** 2 + variance - np.log(variance)
    return ExpectedFit(bands.power(rest), asks, np.asarray(amounts), float(unlikely.sum()))
