"""Likelihood of a noise model: traces, their motion, settings, parameters and score."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PositiveFloat

from hdbench.errors import DataError
from hdbench.filter.kalman import USABLE
from hdbench.filter.model import FilterModel, OscillatorBlock, SlowBlock, SlowKind
from hdbench.filter.online import Channels, run_channels
from hdbench.records import FloatArray
from hdbench.results import Part

_LEAST_SAMPLES = 2000

OUTPUT_ORDER = 0.5
"""Orders below belong to the output: what takes them turns at a frequency below a torque's."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion of all traces together, and the variance of their torque."""

    samples: int
    duration_s: float
    period_s: float
    turned_rad: float
    speed_rad_s: float  # mean of its size while it turned
    slowest_rad_s: float  # 5 % and 95 % points of that size
    fastest_rad_s: float
    speed_spread: float
    torque_variance_nm2: float


def check_records(records: Sequence[Channels]) -> None:
    """Refuse traces that no noise can be estimated from."""
    if not records:
        raise DataError("found no trace", where="tune", fix="name at least one trace or run")
    for record in records:
        n = int(np.count_nonzero(record.usable))
        if n < _LEAST_SAMPLES:
            raise DataError(
                f"{n} of {len(record.torque_nm)} samples have torque and velocity, neither missing "
                f"nor saturated; needed: at least {_LEAST_SAMPLES}",
                where=record.source,
                fix="give a longer trace, or one whose channels are in range",
            )


def describe_motion(records: Sequence[Channels]) -> Motion:
    """Return what the traces' motion can tell."""
    samples, duration, turned, periods = 0, 0.0, 0.0, []
    speeds, torques = [], []
    for record in records:
        usable = record.usable
        samples += int(np.count_nonzero(usable))
        steps = np.diff(record.time_s)
        duration += float(record.time_s[-1] - record.time_s[0])
        periods.append(float(np.median(steps)))
        speed = np.abs(np.where(np.abs(record.velocity_rad_s) <= USABLE, record.velocity_rad_s, 0))
        turned += float(np.sum(speed[:-1] * steps))
        speeds.append(speed[usable])
        torque = record.torque_nm[usable]
        torques.append(torque - np.mean(torque))
    speed = np.concatenate(speeds)
    # a hundredth of the fastest is standstill, tacho noise included
    moving = speed[speed > 0.01 * float(np.max(speed))]
    mean = float(np.mean(moving)) if moving.size else 0.0
    return Motion(
        samples=samples,
        duration_s=duration,
        period_s=float(np.median(periods)),
        turned_rad=turned,
        speed_rad_s=mean,
        slowest_rad_s=float(np.quantile(moving, 0.05)) if moving.size else 0.0,
        fastest_rad_s=float(np.quantile(moving, 0.95)) if moving.size else 0.0,
        speed_spread=float(np.std(moving)) / mean if mean > 0.0 else 0.0,
        torque_variance_nm2=float(np.mean(np.square(np.concatenate(torques)))),
    )


def noise_guess_nm2(records: Sequence[Channels]) -> float:
    """Return a first guess of the measurement noise, from third differences of the torque."""
    guesses = []
    for record in records:
        third = np.diff(record.torque_nm, 3)
        third = third[np.isfinite(third)]
        if third.size:
            # the median of squares of a normal variable is 0.4549 of its variance
            guesses.append(float(np.median(np.square(third))) / (0.4549 * 20.0))
    guess = float(np.median(guesses)) if guesses else 0.0
    if not 0.0 < guess < math.inf:
        raise DataError(
            "the torque has no noise: most third differences are 0 or missing",
            where=", ".join(record.source for record in records),
            fix="give the torque as it was sampled, neither held nor rounded to few steps",
        )
    return guess


_STUCK = 20  # equal samples in a row; with noise of a step or more chance gives them in 1e8 s


def stuck_after(records: Sequence[Channels], noise_nm2: float) -> int | None:
    """Return from how many equal samples in a row on a converter is stuck."""
    steps = np.concatenate([np.abs(np.diff(record.torque_nm)) for record in records])
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    if not steps.size or not math.sqrt(noise_nm2) >= float(np.min(steps)):
        return None
    return _STUCK


_PREVIEW_SAMPLES = 12_000  # a dozen seconds at 1 kHz: an output turn, and slow torque at 0.3 Hz


def preview(record: Channels) -> Channels:
    """Return a middle part of a trace, enough to come near the most likely point."""
    n = record.time_s.size
    if n <= _PREVIEW_SAMPLES:
        return record
    first = (n - _PREVIEW_SAMPLES) // 2
    part = slice(first, first + _PREVIEW_SAMPLES)
    return replace(
        record,
        time_s=record.time_s[part],
        velocity_rad_s=record.velocity_rad_s[part],
        torque_nm=record.torque_nm[part],
        angle_rad=None if record.angle_rad is None else record.angle_rad[part],
    )


SlowChoice = Literal["auto", "none"] | SlowKind


class TuningSettings(Part, kw_only=False):
    """Settings of a tuning: priors, kind of slow torque, gate, limits.

    Parameters
    ----------
    order_prior_std_nm : float
        Standard deviation of ripple and misalignment before the first sample, N m, > 0.
    slow_prior_std_nm : float
        The same of a constant torque, N m, > 0.
    slow : str
        ``auto``: the stationary kind that the likelihood prefers, beside a slowly walking offset;
        ``none``: no torque but the expected one; or one kind by name.
    gate_sigma : float or None
        Samples beyond so many standard deviations of their innovation count as outliers; None
        keeps all.
    torque_limit_nm : float or None
        Torque at or beyond which the sensor is saturated, N m; None where it is not known.
    max_evaluations : int
        Evaluations of the likelihood per start, >= 50.

    Raises
    ------
    ValueError
        If a number or choice is out of its domain.
    """

    order_prior_std_nm: PositiveFloat
    slow_prior_std_nm: PositiveFloat
    slow: SlowChoice = "auto"
    # below 4 a gate cuts into Gaussian noise: one sample in 16 000
    gate_sigma: Annotated[float, Field(ge=4.0)] | None = 6.0
    torque_limit_nm: PositiveFloat | None = None
    max_evaluations: Annotated[int, Field(ge=50)] = 1500


LogLikelihood = Callable[[FloatArray], float]
_WALKS = ("none", "random-walk", "integrated-random-walk")
# a wander of a tenth of the torque's deviation per own turn is no longer an order
_LARGEST_WANDER = 0.01
_HIGHEST_HZ = 20.0  # above, a tone is a disturbance of the sensor, not torque of the load
_SHARPEST = 1e6  # 2 pi f T of a resonance that no record of hours can tell from a sine


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of the model, varied as its logarithm."""

    name: str
    unit: str
    block: int | None  # place of its order among the blocks; None of a number of the slow torque
    field: str
    relative: bool  # whether it scales with the measurement noise
    starts: tuple[float, ...]  # logarithms, as are the bounds
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class Problem:
    """A model with its free numbers."""

    base: FilterModel  # measurement noise 1, priors in units of it
    parameters: tuple[Parameter, ...]

    def model(self, logs: Sequence[float] | FloatArray) -> FilterModel:
        """Return the model at a point, at measurement noise 1."""
        blocks, slow = list(self.base.blocks), list(self.base.slow)
        numbers: dict[str, float] = {}
        for parameter, value in zip(self.parameters, logs, strict=True):
            number, place = math.exp(float(value)), parameter.block
            if place is None:
                numbers[parameter.field] = number
            else:
                blocks[place] = replace(blocks[place], process_noise=number)
        if numbers:
            slow[-1] = _slow_with(slow[-1], numbers)
        return replace(self.base, blocks=tuple(blocks), slow=tuple(slow))

    def likelihood(self, records: Sequence[Channels]) -> LogLikelihood:
        """Return the log-likelihood of traces as a function of the point, nats."""

        def value(logs: FloatArray) -> float:
            return score(self.model(logs), records).log_likelihood

        return value

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper ends of every parameter, logarithms."""
        ends = [(p.lower, p.upper) for p in self.parameters]
        return np.array([low for low, _ in ends]), np.array([high for _, high in ends])

    def starts(self) -> list[list[float]]:
        """Return the points that the search starts from."""
        count = max((len(p.starts) for p in self.parameters), default=1)
        return [
            [p.starts[min(k, len(p.starts) - 1)] for p in self.parameters] for k in range(count)
        ]


def _slow_with(block: SlowBlock, numbers: dict[str, float]) -> SlowBlock:
    numbers = dict(numbers)
    if "sharpness" in numbers:  # 2 pi f T of a resonance
        hz = numbers.get("frequency_hz", block.frequency_hz)
        numbers["time_constant_s"] = numbers.pop("sharpness") / (2.0 * math.pi * hz)
    values = {name: numbers.get(name, getattr(block, name)) for name in block.parameters}
    return SlowBlock(block.kind, **values)


def build_problem(
    base: FilterModel, kind: SlowKind | None, motion: Motion, noise_nm2: float
) -> Problem:
    """Return what is varied for one kind of slow torque."""
    excess = max(motion.torque_variance_nm2 / noise_nm2, 1.0)
    parameters = [_order_parameter(i, block, motion, excess) for i, block in enumerate(base.blocks)]
    if kind is None:
        return Problem(base, tuple(parameters))
    parameters += _slow_parameters(kind, motion, excess)
    return Problem(replace(base, slow=(*base.slow, _seed(kind))), tuple(parameters))


def _seed(kind: SlowKind) -> SlowBlock:
    """Return a block of the kind, its numbers to be replaced."""
    if kind in ("random-walk", "integrated-random-walk"):
        return SlowBlock(kind, noise_per_s=1.0)
    hz = 1.0 if kind == "resonance" else 0.0
    return SlowBlock(kind, variance=1.0, time_constant_s=1.0, frequency_hz=hz)


def _order_parameter(
    index: int, block: OscillatorBlock, motion: Motion, excess: float
) -> Parameter:
    """Process noise of an order per radian of the motor, of a tone per second."""
    if block.frequency_hz > 0.0:
        name, unit, own_turn = f"{block.frequency_hz:g} Hz", "(N m)^2/s", 1.0 / block.frequency_hz
        step, whole = motion.period_s, motion.duration_s
    else:
        name, unit = f"order {block.order:g}", "(N m)^2/rad"
        own_turn = 2.0 * math.pi / block.order
        step = max(motion.speed_rad_s, 1e-3) * motion.period_s
        whole = max(motion.turned_rad, own_turn)
    # q/R of a block that remembers m (rad or s): white noise of density step, so q = step / m^2
    upper = math.log(max(_LARGEST_WANDER * excess / own_turn, step / own_turn**2 * 1e-6))
    lower = min(math.log(step / (30.0 * whole) ** 2), upper - 1.0)
    start = min(max(math.log(step / (0.3 * whole) ** 2), lower), upper)
    return Parameter(
        f"{name} process_noise", unit, index, "process_noise", True, (start,), lower, upper
    )


def _slow_parameters(kind: SlowKind, motion: Motion, excess: float) -> list[Parameter]:
    dt, whole, size = motion.period_s, motion.duration_s, math.log(excess)

    def one(
        field: str, unit: str, starts: tuple[float, ...], bounds: tuple[float, float]
    ) -> Parameter:
        lower, upper = bounds
        relative = field in ("variance", "noise_per_s")
        inside = tuple(min(max(value, lower), upper) for value in starts)
        return Parameter(f"{kind} {field}", unit, None, field, relative, inside, lower, upper)

    if kind == "random-walk":
        return [one("noise_per_s", "(N m)^2/s", (size, size - 5.0), (-25.0, size + 15.0))]
    if kind == "integrated-random-walk":
        return [one("noise_per_s", "(N m/s)^2/s", (size + 4.0, size - 2.0), (-25.0, size + 25.0))]
    sizes = (size - 0.5, size - 3.0, size + 1.0)  # the third: steps of the load
    variance = one("variance", "(N m)^2", sizes, (-12.0, size + 8.0))
    longest = math.log(10.0 * whole)
    if kind != "resonance":
        bounds = (math.log(0.3 * dt), longest)
        times = (math.log(100.0 * dt), math.log(0.02 * whole), math.log(0.25 * whole))
        return [variance, one("time_constant_s", "s", times, bounds)]
    bounds = (math.log(0.2 / whole), math.log(min(_HIGHEST_HZ, 0.05 / dt)))
    return [
        one("variance", "(N m)^2", sizes[:2], (-12.0, size + 8.0)),
        one("frequency_hz", "Hz", (math.log(2.0), math.log(0.3)), bounds),
        one("sharpness", "1", (math.log(1.5), math.log(3.0)), (0.0, math.log(_SHARPEST))),
    ]


@dataclass(frozen=True, slots=True)
class Score:
    """Likelihood of traces under a model of measurement noise 1."""

    samples: int
    noise_nm2: float  # the measurement noise that fits best
    log_likelihood: float


def score(model: FilterModel, records: Sequence[Channels]) -> Score:
    r"""Score a model of measurement noise 1 on traces.

    Notes
    -----
    With innovations e and variances S of the relative model over n samples of all traces,
    :math:`\hat R = \sum e^2/S / n` and
    :math:`2 \ln L = -n (1 + \ln 2\pi + \ln \hat R) - \sum \ln S`.
    """
    samples, logs, squares = 0, 0.0, 0.0
    for record in records:
        found = run_channels(model, record)
        samples += found.n_used
        logs += found.sum_log_variance
        squares += found.sum_normalised_squares
    noise = squares / samples if samples else math.nan
    if not 0.0 < noise < math.inf:
        return Score(samples, noise, -math.inf)
    value = -0.5 * (samples * (1.0 + math.log(2.0 * math.pi * noise)) + logs)
    return Score(samples, noise, value)


def scaled(relative: FilterModel, noise_nm2: float) -> FilterModel:
    """Return a model of measurement noise 1 in absolute units."""
    scale = math.sqrt(noise_nm2)
    prior, slow_prior = relative.order_prior_std_nm, relative.slow_prior_std_nm
    return replace(
        relative,
        blocks=tuple(
            replace(block, process_noise=block.process_noise * noise_nm2)
            for block in relative.blocks
        ),
        slow=tuple(
            replace(
                block,
                noise_per_s=block.noise_per_s * noise_nm2,
                variance=block.variance * noise_nm2,
            )
            for block in relative.slow
        ),
        measurement_noise=noise_nm2,
        order_prior_std_nm=None if prior is None else prior * scale,
        slow_prior_std_nm=None if slow_prior is None else slow_prior * scale,
    )


def relative_model(
    base: FilterModel, motion: Motion, noise_nm2: float, settings: TuningSettings
) -> FilterModel:
    """Return the model at measurement noise 1: noise per angle, priors relative, the offset."""
    scale = math.sqrt(noise_nm2)
    blocks = tuple(
        OscillatorBlock(
            block.order,
            block.role,
            block.process_noise,
            "second" if block.frequency_hz > 0.0 else "motor-radian",
            block.frequency_hz,
        )
        for block in base.blocks
    )
    walking = settings.slow in _WALKS
    offset = () if walking else (SlowBlock("random-walk", noise_per_s=_offset_noise(base, motion)),)
    return replace(
        base,
        blocks=blocks,
        slow=offset,
        measurement_noise=1.0,
        order_prior_std_nm=settings.order_prior_std_nm / scale,
        slow_prior_std_nm=settings.slow_prior_std_nm / scale,
        gate_sigma=None,
        tuning=None,
    )


def _offset_noise(base: FilterModel, motion: Motion) -> float:
    r"""Return the wander of the offset per second, relative to the measurement noise.

    A random walk has the density q / w^2, white noise R dt: equal at the slowest block's angular
    frequency w, so that the offset can never hold what turns with the output.
    """
    slowest = min((b.order for b in base.blocks if b.order > 0.0), default=1.0)
    w = slowest * motion.speed_rad_s
    if not w > 0.0:
        w = 2.0 * math.pi / motion.duration_s
    return motion.period_s * w * w
