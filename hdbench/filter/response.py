"""Response of a filter at a steady speed: notches, torque passed, noise, settling time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.filter.kalman import BLOCK, MODEL_HEADER, PRIOR, new_state, pack, run
from hdbench.filter.model import FilterModel
from hdbench.filter.steady import SteadyFilter, steady_filter
from hdbench.records import FloatArray

_HALF_POWER = math.sqrt(0.5)
_PASSED_HZ = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0)
_CURVE_POINTS = 400
_LEFT = 0.02  # share of a disturbance that is left when it counts as settled


@dataclass(frozen=True, slots=True)
class Notch:
    """The notch of one block."""

    name: str
    frequency_hz: float
    depth_db: float
    lower_hz: float | None  # half power on either side, where it is reached
    upper_hz: float | None

    @property
    def width_hz(self) -> float | None:
        """Distance of the half-power points, Hz; None where there are not two."""
        if self.lower_hz is None or self.upper_hz is None:
            return None
        return self.upper_hz - self.lower_hz


@dataclass(frozen=True, slots=True)
class Passed:
    """How much of a slow torque comes through."""

    frequency_hz: float
    gain: float  # 1 keeps the torque; what is missing is replaced by the expected torque
    phase_rad: float

    @property
    def delay_s(self) -> float | None:
        """Phase delay, s; None at frequency 0."""
        if not self.frequency_hz > 0.0:
            return None
        return -self.phase_rad / (2.0 * math.pi * self.frequency_hz)


@dataclass(frozen=True, slots=True)
class Response:
    """The steady response of a filter model at one speed."""

    velocity_rad_s: float
    sample_period_s: float
    notches: tuple[Notch, ...]
    passed: tuple[Passed, ...]
    noise_gain: float  # standard deviation of filtered over measured white noise
    settling_time_s: float | None  # until 2 % are left of what the slowest state forgets
    frequency_hz: FloatArray
    transfer: NDArray[np.complex128]

    def to_dict(self) -> dict[str, object]:
        """Return the response as results store it."""
        return {
            "velocity_rad_s": self.velocity_rad_s,
            "gain_at_zero": self.passed[0].gain,
            "notches": [{**asdict(n), "width_hz": n.width_hz} for n in self.notches],
            "passed": [{**asdict(p), "delay_s": p.delay_s} for p in self.passed],
            "noise_gain": self.noise_gain,
            "settling_time_s": self.settling_time_s,
            "curve": {
                "frequency_hz": self.frequency_hz.tolist(),
                "gain": np.abs(self.transfer).tolist(),
                "phase_rad": np.angle(self.transfer).tolist(),
            },
        }


def filter_response(model: FilterModel, velocity_rad_s: float, sample_period_s: float) -> Response:
    """Return what a model does to the torque at a constant speed, after all time."""
    steady = steady_filter(model, velocity_rad_s, sample_period_s)
    nyquist = 0.5 / sample_period_s
    places = [_place(block.order, block.frequency_hz, velocity_rad_s) for block in model.blocks]
    known = [hz for hz, _ in places if hz < nyquist]
    curve = _curve(known, nyquist)
    low = np.array([hz for hz in _PASSED_HZ if hz < nyquist])
    slow = steady.transfer(low)
    mode = steady.slowest_mode_s()
    return Response(
        velocity_rad_s=velocity_rad_s,
        sample_period_s=sample_period_s,
        notches=tuple(_notch(steady, hz, name, known, nyquist) for hz, name in places),
        passed=tuple(
            Passed(float(hz), float(abs(h)), float(np.angle(h)))
            for hz, h in zip(low, slow, strict=True)
        ),
        noise_gain=steady.noise_gain(),
        settling_time_s=-mode * math.log(_LEFT) if math.isfinite(mode) else None,
        frequency_hz=curve,
        transfer=steady.transfer(curve),
    )


def _place(order: float, frequency_hz: float, velocity_rad_s: float) -> tuple[float, str]:
    """Return frequency and name of a block at a speed."""
    if frequency_hz > 0.0:
        return frequency_hz, f"{frequency_hz:g} Hz"
    return order * abs(velocity_rad_s) / (2.0 * math.pi), f"order {order:g}"


def _curve(notches: list[float], nyquist: float) -> FloatArray:
    """Return frequencies for a plot: logarithmic, denser at the notches."""
    lowest = 0.2 * min([*notches, 0.5])
    grid = [np.geomspace(lowest, 0.999 * nyquist, _CURVE_POINTS)]
    offsets = np.geomspace(1e-4, 0.2, 20)
    for hz in notches:
        grid += [hz * (1.0 - offsets), np.array([hz]), hz * (1.0 + offsets)]
    return np.unique(np.clip(np.concatenate(grid), lowest, 0.999 * nyquist))


def _notch(
    steady: SteadyFilter, hz: float, name: str, others: list[float], nyquist: float
) -> Notch:
    depth = float(abs(steady.transfer(np.array([hz]))[0]))
    below = max((x for x in (0.0, *others) if x < hz), default=0.0)
    above = min((x for x in (nyquist, *others) if x > hz), default=nyquist)
    return Notch(
        name,
        hz,
        20.0 * math.log10(max(depth, 1e-15)),
        _half_power(steady, hz, below - hz),
        _half_power(steady, hz, above - hz),
    )


def _half_power(steady: SteadyFilter, hz: float, room: float) -> float | None:
    """Return where |H| first comes back to half power towards `hz + room`."""
    if not abs(room) > 0.0:
        return None
    offsets = abs(room) * np.geomspace(1e-9, 1.0, 181)
    side = math.copysign(1.0, room)
    back = np.flatnonzero(np.abs(steady.transfer(hz + side * offsets)) >= _HALF_POWER)
    if not back.size or back[0] == 0:
        return None
    low, high = float(offsets[back[0] - 1]), float(offsets[back[0]])
    for _ in range(20):
        middle = math.sqrt(low * high)
        gain = float(abs(steady.transfer(np.array([hz + side * middle]))[0]))
        low, high = (low, middle) if gain >= _HALF_POWER else (middle, high)
    return hz + side * high


@dataclass(frozen=True, slots=True)
class Injection:
    """A sinusoid sent through the running filter, beside the algebra."""

    frequency_hz: float
    measured: float
    algebra: float


def inject(
    model: FilterModel,
    velocity_rad_s: float,
    sample_period_s: float,
    frequency_hz: Sequence[float],
    *,
    samples: int = 60_000,
) -> tuple[Injection, ...]:
    """Send sinusoids through the running filter and measure what comes out.

    Notes
    -----
    The recursion starts at its steady variances, so that its gain is soon the steady one; what its
    states have not forgotten by the second half is left in the answer.
    """
    steady = steady_filter(model, velocity_rad_s, sample_period_s)
    packed = pack(model)
    # no gate, and the steady variances as the prior
    packed[6], packed[8] = 0.0, 1.0
    prior = np.maximum(np.diag(steady.covariance).reshape(-1, 2), 0.0)
    packed[MODEL_HEADER:].reshape(-1, BLOCK)[:, PRIOR : PRIOR + 2] = prior
    time = np.arange(samples) * sample_period_s
    velocity = np.full(samples, velocity_rad_s)
    found = []
    for hz in frequency_hz:
        angle = 2.0 * math.pi * hz * time
        block = run(packed, new_state(packed), time, velocity, np.cos(angle))
        late = slice(samples // 2, samples)
        basis = np.stack((np.cos(angle), np.sin(angle)), axis=1)[late, : 2 if hz > 0.0 else 1]
        fit = np.linalg.lstsq(basis, block.torque_filtered_nm[late], rcond=None)[0]
        algebra = float(abs(steady.transfer(np.array([hz]))[0]))
        found.append(Injection(hz, float(np.hypot.reduce(fit)), algebra))
    return tuple(found)
