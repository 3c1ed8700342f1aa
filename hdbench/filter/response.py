"""Response of a filter: at constant speed after all time, and by an injected sine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdbench.errors import DataError
from hdbench.filter.fallback import transitions
from hdbench.filter.kalman import BLOCK, MODEL_HEADER, PRIOR, new_state, pack, run
from hdbench.filter.model import FilterModel, OscillatorBlock
from hdbench.records import FloatArray

_DOUBLINGS = 60  # 2^60 samples: what has not converged then never will
_SETTLED = 1e-13  # relative change of P in one doubling: rounding


@dataclass(frozen=True, slots=True)
class SteadyFilter:
    r"""The filter at one speed after all time, as a linear system.

    Notes
    -----
    With measured torque y: :math:`x(k+1) = A x(k) + B y(k)`, filtered torque
    :math:`y(k) - c\,x(k)`, c = `taken`.
    """

    closed: FloatArray  # A = F (I - K C)
    gain: FloatArray  # B = F K
    taken: FloatArray  # 1 at the first state of every block that is taken off the torque
    covariance: FloatArray  # of the predicted states
    sample_period_s: float

    def transfer(self, frequency_hz: FloatArray) -> NDArray[np.complex128]:
        """Return filtered over measured torque."""
        n = self.gain.size
        z = np.exp(2j * np.pi * frequency_hz * self.sample_period_s)
        inner = z[:, None, None] * np.eye(n) - self.closed
        right = np.broadcast_to(self.gain[:, None], (z.size, n, 1)).astype(np.complex128)
        return np.asarray(1.0 - (np.linalg.solve(inner, right)[:, :, 0] @ self.taken))

    def noise_gain(self) -> float:
        """Return the standard deviation of filtered over that of white measured noise."""
        spread = _geometric_sum(self.closed, self.gain[:, None] * self.gain)
        return math.sqrt(1.0 + float(self.taken @ spread @ self.taken))

    def slowest_mode_s(self) -> float:
        """Return the time constant of the mode that forgets last, s; infinite where none does."""
        largest = float(np.max(np.abs(np.linalg.eigvals(self.closed))))
        if not largest < 1.0:
            return math.inf
        return -self.sample_period_s / math.log(largest) if largest > 0.0 else 0.0


def _geometric_sum(a: FloatArray, q: FloatArray) -> FloatArray:
    """Return the sum of A^k Q A'^k over k >= 0, by doubling."""
    total, power = q.copy(), a.copy()
    for _ in range(_DOUBLINGS):
        step = power @ total @ power.T
        total = total + step
        if not np.max(np.abs(step)) > _SETTLED * np.max(np.abs(total)):
            break
        power = power @ power
    return total


def steady_filter(
    model: FilterModel, velocity_rad_s: float, sample_period_s: float
) -> SteadyFilter:
    """Return the filter at a constant speed after all time.

    Notes
    -----
    Structure-preserving doubling of the Riccati equation: the k-th step stands for 2^k samples, so
    that a filter with a memory of days converges as surely as one of milliseconds.

    References
    ----------
    .. [1] B. D. O. Anderson, "Second-order convergent algorithms for the steady-state Riccati
       equation", International Journal of Control 28 (1978) 295-306.
    """
    if not (0.0 < abs(velocity_rad_s) < math.inf and 0.0 < sample_period_s < math.inf):
        reason = f"needed a velocity other than 0, and a period above 0, found {sample_period_s!r}"
        raise _no_steady_gain(velocity_rad_s, reason)
    steps = transitions(pack(model), velocity_rad_s * sample_period_s, sample_period_s)
    n_states = [2] * len(model.blocks) + [block.n_states for block in model.slow]
    # kinds of one state have no second one
    kept = np.array([2 * i + j for i, n in enumerate(n_states) for j in range(n)], dtype=np.intp)
    f, q = _dense(steps, kept)
    c = np.tile((1.0, 0.0), len(n_states))[kept]
    taken = np.where(kept < 2 * len(model.blocks), c, 0.0)
    p = _steady_covariance(f, q, c, model.measurement_noise, velocity_rad_s)
    k = p @ c / (model.measurement_noise + float(c @ p @ c))
    closed = f - np.outer(f @ k, c)
    covariance = np.zeros((2 * len(n_states), 2 * len(n_states)))
    covariance[np.ix_(kept, kept)] = p
    return SteadyFilter(closed, f @ k, taken, covariance, sample_period_s)


def transfer_at_steady_speed(
    model: FilterModel,
    velocity_rad_s: float,
    sample_period_s: float,
    frequency_hz: ArrayLike,
) -> NDArray[np.complex128]:
    r"""Return the steady transfer function from measured to filtered torque.

    Parameters
    ----------
    model : FilterModel
        Orders and noise.
    velocity_rad_s : float
        Constant motor velocity, rad/s, not 0.
    sample_period_s : float
        Sampling period, s, > 0.
    frequency_hz : array_like
        Frequencies, Hz.

    Returns
    -------
    ndarray of complex, shape of `frequency_hz`
        Filtered over measured torque, dimensionless, at expected torque 0.

    Raises
    ------
    DataError
        If no steady gain exists: at standstill, or where two blocks alias to one frequency.

    Notes
    -----
    The steady P solves the Riccati equation of the recursion; with the transition F and
    :math:`K = F P C^T / (R + C P C^T)`, and c that picks the blocks taken off the torque,
    :math:`H(z) = 1 - c (z I - F + K C)^{-1} K`, zero at every block's own frequency.
    """
    steady = steady_filter(model, velocity_rad_s, sample_period_s)
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    response = steady.transfer(frequency.ravel())
    return np.asarray(response.reshape(frequency.shape), dtype=np.complex128)


def _dense(steps: FloatArray, kept: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
    """Return F and Q as dense matrices over the states kept."""
    n = 2 * steps.shape[0]
    f, q = np.zeros((n, n)), np.zeros((n, n))
    for i, step in enumerate(steps):
        at = slice(2 * i, 2 * i + 2)
        f[at, at] = step[:4].reshape(2, 2)
        q[at, at] = [[step[4], step[5]], [step[5], step[6]]]
    return f[np.ix_(kept, kept)], q[np.ix_(kept, kept)]


def _steady_covariance(
    f: FloatArray, q: FloatArray, c: FloatArray, r: float, velocity_rad_s: float
) -> FloatArray:
    """Return P of the Riccati equation P = F (P - P C' C P / S) F' + Q."""
    a, g, h = f.T.copy(), np.outer(c, c) / r, q.copy()
    identity = np.eye(c.size)
    for _ in range(_DOUBLINGS):
        try:
            w = np.linalg.solve(identity + g @ h, np.hstack((a, g)))
        except np.linalg.LinAlgError as error:
            raise _no_steady_gain(velocity_rad_s, str(error)) from error
        wa, wg = w[:, : c.size], w[:, c.size :]
        step = a.T @ h @ wa
        h = h + 0.5 * (step + step.T)
        g = g + a @ wg @ a.T
        g = 0.5 * (g + g.T)
        a = a @ wa
        if not np.isfinite(h).all():
            break
        if np.max(np.abs(step)) <= _SETTLED * np.max(np.abs(h)):
            return h
    raise _no_steady_gain(velocity_rad_s, "two blocks have one frequency")


def _no_steady_gain(velocity_rad_s: float, reason: str) -> DataError:
    return DataError(
        f"the filter has no steady gain at {velocity_rad_s!r} rad/s: {reason}",
        where="velocity_rad_s",
        fix="ask at a velocity at which the blocks have different frequencies",
    )


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
    width_hz: float | None  # between the two


@dataclass(frozen=True, slots=True)
class Passed:
    """How much of a slow torque comes through."""

    frequency_hz: float
    gain: float  # 1 keeps the torque; what is missing is replaced by the expected torque
    phase_rad: float
    delay_s: float | None  # of the phase; None at frequency 0


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
            "notches": [asdict(notch) for notch in self.notches],
            "passed": [asdict(passed) for passed in self.passed],
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
    places = [block.frequency_at(velocity_rad_s) for block in model.blocks]
    known = [hz for hz in places if hz < nyquist]
    curve = _curve(known, nyquist)
    mode = steady.slowest_mode_s()
    return Response(
        velocity_rad_s=velocity_rad_s,
        sample_period_s=sample_period_s,
        notches=tuple(
            _notch(steady, hz, block, known, nyquist)
            for hz, block in zip(places, model.blocks, strict=True)
        ),
        passed=_passed(steady, [hz for hz in _PASSED_HZ if hz < nyquist]),
        noise_gain=steady.noise_gain(),
        settling_time_s=-mode * math.log(_LEFT) if math.isfinite(mode) else None,
        frequency_hz=curve,
        transfer=steady.transfer(curve),
    )


def _passed(steady: SteadyFilter, frequency_hz: list[float]) -> tuple[Passed, ...]:
    found = []
    for hz, h in zip(frequency_hz, steady.transfer(np.array(frequency_hz)), strict=True):
        phase = float(np.angle(h))
        delay = -phase / (2.0 * math.pi * hz) if hz > 0.0 else None
        found.append(Passed(hz, float(abs(h)), phase, delay))
    return tuple(found)


def _curve(notches: list[float], nyquist: float) -> FloatArray:
    """Return frequencies for a plot: logarithmic, denser at the notches."""
    lowest = 0.2 * min([*notches, 0.5])
    grid = [np.geomspace(lowest, 0.999 * nyquist, _CURVE_POINTS)]
    offsets = np.geomspace(1e-4, 0.2, 20)
    for hz in notches:
        grid += [hz * (1.0 - offsets), np.array([hz]), hz * (1.0 + offsets)]
    return np.unique(np.clip(np.concatenate(grid), lowest, 0.999 * nyquist))


def _notch(
    steady: SteadyFilter, hz: float, block: OscillatorBlock, others: list[float], nyquist: float
) -> Notch:
    name = f"{hz:g} Hz" if block.frequency_hz > 0.0 else f"order {block.order:g}"
    depth = float(abs(steady.transfer(np.array([hz]))[0]))
    below = max((x for x in (0.0, *others) if x < hz), default=0.0)
    above = min((x for x in (nyquist, *others) if x > hz), default=nyquist)
    lower, upper = (_half_power(steady, hz, end - hz) for end in (below, above))
    width = None if lower is None or upper is None else upper - lower
    return Notch(name, hz, 20.0 * math.log10(max(depth, 1e-15)), lower, upper, width)


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
        block = run(packed, new_state(packed), (time, velocity, np.cos(angle), None))
        late = slice(samples // 2, samples)
        basis = np.stack((np.cos(angle), np.sin(angle)), axis=1)[late, : 2 if hz > 0.0 else 1]
        fit = np.linalg.lstsq(basis, block.torque_filtered_nm[late], rcond=None)[0]
        algebra = float(abs(steady.transfer(np.array([hz]))[0]))
        found.append(Injection(hz, float(np.hypot.reduce(fit)), algebra))
    return tuple(found)
