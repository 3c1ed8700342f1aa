"""Kalman filter of order-locked torque: run, batch and smooth, compiled or in NumPy."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdbench.errors import DataError, UsageError
from hdbench.filter.model import FilterModel, SlowBlock, SlowKind
from hdbench.records import FloatArray

Form = Literal["c", "numpy"]
_VARIABLE = "HDBENCH_KERNEL"
GATE_SAMPLES = 5
"""So many samples in a row are gated at most: a step of the torque is not refused for ever."""

# places in the packed model: a header, then one row for each block
MODEL_HEADER, BLOCK = 9, 11
PRIOR = 9
# places in the state: a header, then psi and its rounding [2 n], z [2 n], g [2 n], the lower
# triangle of P, as kernel/filter.h says
SEEN, HAS_VELOCITY, HAS_ANGLE, STARTED = 0, 1, 2, 3
TIME, VELOCITY, VELOCITY_TIME, ACCELERATION, ANGLE, GATED_RUN = 4, 5, 6, 7, 8, 9
INVERSE, STEP = 10, 11
"""1/S and e/S of the last sample: what its measurement is still to do to states and covariance."""
HEADER = 12
USABLE = 1e12
"""Beyond this magnitude (rad/s, rad, N m) a sample is a fault and counts as missing."""
MISSING, GATED, UNRESOLVED = 1, 2, 4
"""Bits of a sample's flag."""


@dataclass(frozen=True, slots=True)
class FilteredBlock:
    """Filtered samples; arrays of shape (n_samples,), N m unless said otherwise.

    Parameters
    ----------
    torque_expected_nm : ndarray
        J_load * acceleration / N by the online differentiator.
    ripple_nm : ndarray
        Predicted sum of the ripple blocks, from earlier samples only.
    misalignment_nm : ndarray
        Predicted sum of the output-order blocks, from earlier samples only.
    slow_nm : ndarray
        Predicted slow torque, which the filtered torque keeps; 0 where the model has none.
    torque_filtered_nm : ndarray
        Torque minus both predictions; NaN where the torque is missing.
    innovation_nm : ndarray
        Torque minus everything predicted; NaN where the sample is missing.
    innovation_variance_nm2 : ndarray
        Its variance by the model, (N m)^2; NaN before the filter has started.
    flags : ndarray of uint8
        0, or bits: 1 missing, 2 gated as an outlier, 4 an order not resolved (its variance is
        beyond 200 innovation variances, as at standstill), 8 saturated, 16 stuck.
    n_used : int
        Samples that were used as measurements.
    sum_log_variance, sum_normalised_squares : float
        Sum of log S and of e^2 / S over these samples; with R and all Q scaled by one factor, that
        factor's best value is ``sum_normalised_squares / n_used``.
    """

    torque_expected_nm: FloatArray
    ripple_nm: FloatArray
    misalignment_nm: FloatArray
    slow_nm: FloatArray
    torque_filtered_nm: FloatArray
    innovation_nm: FloatArray
    innovation_variance_nm2: FloatArray
    flags: NDArray[np.uint8]
    n_used: int
    sum_log_variance: float
    sum_normalised_squares: float

    @property
    def log_likelihood(self) -> float:
        """Gaussian log-likelihood of the samples used, nats."""
        sums = self.sum_log_variance + self.sum_normalised_squares
        return -0.5 * (self.n_used * math.log(2.0 * math.pi) + sums)


@dataclass(frozen=True, slots=True)
class BatchResult:
    """Filtered traces, one per column: arrays (n, n_traces), and sums (n_traces,)."""

    torque_filtered_nm: FloatArray
    innovation_nm: FloatArray | None
    innovation_variance_nm2: FloatArray | None
    n_used: FloatArray
    sum_log_variance: FloatArray
    sum_normalised_squares: FloatArray


@dataclass(frozen=True, slots=True)
class SmoothResult:
    """Blocks from all samples, before and after each one.

    `mean` has shape (n, n_blocks, 2): an oscillator's torque A cos(psi) and -A sin(psi), N m; a
    slow torque and its slope (0 for kinds of one state). `covariance` is (p11, p12, p22) of each
    block, (N m)^2.
    """

    mean: FloatArray
    covariance: FloatArray
    torque_expected_nm: FloatArray


# time, s, velocity, rad/s, torque, N m, and the angle, rad, where one turns the blocks
Samples = tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike | None]
Arrays = tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]


def kernel_form(name: str) -> Any:
    """Return the module with run, batch and smooth of a form, ``c`` or ``numpy``."""
    if name == "numpy":
        from hdbench.filter import fallback

        return fallback
    module, reason = _compiled()
    if name != "c" or module is None:
        raise ValueError(f"no filter form {name!r}: {reason}")
    return module


@cache
def _compiled() -> tuple[ModuleType | None, str]:
    try:
        from hdbench.filter import _kernel
    except ImportError:
        return None, "no C kernel was compiled at installation"
    return _kernel, "the C kernel was compiled at installation"


def _choose() -> tuple[Form, str]:
    wanted, where = os.environ.get(_VARIABLE, ""), f"environment variable {_VARIABLE}"
    if wanted not in ("", "c", "numpy"):
        raise UsageError(
            f"{_VARIABLE} is {wanted!r}; needed: c, numpy or nothing",
            where=where,
            fix=f"unset {_VARIABLE}",
        )
    if wanted == "numpy":
        return "numpy", f"{_VARIABLE}=numpy asks for it"
    module, reason = _compiled()
    if module is not None:
        return "c", reason
    if wanted == "c":
        raise UsageError(
            f"{_VARIABLE}=c, but {reason}",
            where=where,
            fix="install again where a C compiler is on PATH, or unset the variable",
        )
    return "numpy", reason


def kernel_name() -> Form:
    """Return which form of the filter runs: ``c`` or ``numpy``.

    Returns
    -------
    str
        ``c`` for the compiled kernel, ``numpy`` for the form that needs no compiler. They agree to
        1e-9 N m.

    Raises
    ------
    UsageError
        If the environment variable HDBENCH_KERNEL names no form, or one that is not there.
    """
    return _choose()[0]


def kernel_reason() -> str:
    """Return one line that says why `kernel_name` is what it is.

    Returns
    -------
    str
        The reason, without a full stop.

    Raises
    ------
    UsageError
        As `kernel_name`.
    """
    return _choose()[1]


def pack(model: FilterModel) -> FloatArray:
    """Return a filter model as the numbers that the kernel reads, oscillators first."""
    gate, prior = model.gate_sigma or 0.0, model.order_prior_std_nm
    header = (
        len(model.blocks),
        len(model.slow),
        model.measurement_noise,
        model.load_inertia_kg_m2,
        model.gear_ratio,
        model.differentiator_time_constant_s,
        gate * gate,
        GATE_SAMPLES,
        float(prior is not None),
    )
    variance = 1.0 if prior is None else prior * prior
    rows: list[tuple[float, ...]] = [header]
    for block in model.blocks:
        q, per = block.process_noise, block.noise_per
        noise = (q if per == unit else 0.0 for unit in ("sample", "motor-radian", "second"))
        omega = 2.0 * math.pi * block.frequency_hz
        part = 1.0 if block.role == "misalignment" else 0.0
        rows.append((0.0, part, block.order, omega, *noise, 0.0, 0.0, variance, variance))
    slow_prior = 1.0 if model.slow_prior_std_nm is None else model.slow_prior_std_nm**2
    rows += [_slow_row(block, slow_prior) for block in model.slow]
    return np.array([value for row in rows for value in row], dtype=np.float64)


def _slow_row(block: SlowBlock, prior: float) -> tuple[float, ...]:
    kind = 1.0 + get_args(SlowKind).index(block.kind)
    natural, rate, damped = 2.0 * math.pi * block.frequency_hz, 0.0, 0.0
    first = second = prior
    if block.stationary:
        rate = 1.0 / block.time_constant_s
        # the stationary covariance of torque and slope
        own = natural or rate
        first, second = block.variance, block.variance * own * own
    if block.kind == "resonance":
        # its damped frequency; a millionth of the natural one differs from critical damping by
        # 1e-12 of the covariance
        damped = max(math.sqrt(max(natural * natural - rate * rate, 0.0)), 1e-6 * natural)
    second = second if block.n_states == 2 else 0.0
    noise = (0.0, 0.0, block.noise_per_s)
    return (kind, 2.0, damped, natural, *noise, rate, block.variance, first, second)


def block_rows(packed: FloatArray) -> list[list[float]]:
    """Return kind, part, order, omega, three noises, rate, variance, two priors of each block."""
    rows: list[list[float]] = packed[MODEL_HEADER:].reshape(-1, BLOCK).tolist()
    return rows


def block_count(packed: FloatArray) -> int:
    """Return the number of blocks of a packed model."""
    return (packed.size - MODEL_HEADER) // BLOCK


def new_state(packed: FloatArray) -> FloatArray:
    """Return the state of a filter that has seen nothing."""
    n = block_count(packed)
    return np.zeros(HEADER + 6 * n + n * (2 * n + 1))


def run(
    packed: FloatArray, state: FloatArray, samples: Samples, *, form: Form | None = None
) -> FilteredBlock:
    r"""Filter the next samples of one trace; `state` is advanced.

    Notes
    -----
    With F the blocks' transitions into sample k and C the sum of all first states:

    .. math::
        x^- = F x, \; P^- = F P F^T + Q, \; S = R + C P^- C^T, \; e = y - C x^-, \;
        x = x^- + P^- C^T e / S, \; P = P^- - P^- C^T C P^- / S

    A missing or gated sample ends after :math:`P^-`. Splitting a trace changes no bit.
    """
    arrays = _checked(samples)
    n, needed = arrays[0].size, new_state(packed).size
    if state.dtype != np.float64 or state.shape != (needed,) or not state.flags.c_contiguous:
        raise ValueError(f"state has shape {state.shape}; needed {needed} float64 numbers")
    sums = np.zeros(3)
    # in the order of `FilteredBlock`; two blocks, not seven arrays: the system hands out larger
    # pages, and keeps them in the process
    expected, ripple, misalignment, slow = np.empty((4, n))
    filtered, innovation, variance = np.empty((3, n))
    outputs = (expected, ripple, misalignment, slow, filtered, innovation, variance)
    flags = np.empty(n, dtype=np.uint8)
    work = kernel_form(form or kernel_name()).run
    _check_time(work(packed, state, arrays, outputs, flags, sums), arrays[0])
    used, logs, squares = sums.tolist()
    return FilteredBlock(*outputs, flags, int(used), logs, squares)


def batch(
    packed: FloatArray, samples: Samples, *, innovations: bool = False, form: Form | None = None
) -> BatchResult:
    """Filter many traces of one model at once, each with the bits that `run` gives it."""
    arrays = _checked(samples, 2)
    time, torque = arrays[0], arrays[2]
    filtered = np.empty_like(torque)
    innovation = np.empty_like(torque) if innovations else None
    variance = np.empty_like(torque) if innovations else None
    sums = np.zeros((3, torque.shape[1]))
    work = kernel_form(form or kernel_name()).batch
    _check_time(work(packed, arrays, (filtered, innovation, variance), sums), time)
    return BatchResult(filtered, innovation, variance, sums[0], sums[1], sums[2])


def smooth(packed: FloatArray, samples: Samples, *, form: Form | None = None) -> SmoothResult:
    r"""Estimate every block from the whole trace (fixed-interval smoother).

    Notes
    -----
    Modified Bryson-Frazier form, which inverts no covariance: backwards in time, with
    :math:`K = P^- C^T / S`,

    .. math::
        \lambda \leftarrow (I - K C)^T \lambda + C^T e / S, \quad
        \Lambda \leftarrow (I - K C)^T \Lambda (I - K C) + C^T C / S, \quad
        \hat x = x^- + P^- \lambda, \quad \hat P = P^- - P^- \Lambda P^-

    and :math:`\lambda \leftarrow F^T \lambda`, :math:`\Lambda \leftarrow F^T \Lambda F`
    across each transition. Two forward passes, so that memory stays small.

    References
    ----------
    .. [1] G. J. Bierman, "Fixed interval smoothing with discrete measurements", International
       Journal of Control 18 (1973) 65-75.
    """
    arrays = _checked(samples)
    n, n_blocks = arrays[0].size, block_count(packed)
    expected, mean, covariance = np.empty(n), np.empty((n, n_blocks, 2)), np.empty((n, n_blocks, 3))
    work = kernel_form(form or kernel_name()).smooth
    _check_time(work(packed, arrays, expected, mean, covariance), arrays[0])
    return SmoothResult(mean, covariance, expected)


def _array(values: ArrayLike, ndim: int) -> FloatArray:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != ndim:
        raise ValueError(f"found an array of shape {array.shape}; needed: {ndim} dimensions")
    return array


def _checked(samples: Samples, ndim: int = 1) -> Arrays:
    """Return samples as the kernel takes them: contiguous, of one shape, time of one dimension."""
    time_s, velocity_rad_s, torque_nm, angle_rad = samples
    time = _array(time_s, 1)
    velocity, torque = _array(velocity_rad_s, ndim), _array(torque_nm, ndim)
    angle = None if angle_rad is None else _array(angle_rad, ndim)
    for name, array in (("torque_nm", torque), ("velocity_rad_s", velocity), ("angle", angle)):
        if array is not None and (len(array) != len(time) or array.shape != torque.shape):
            raise ValueError(f"{name} has shape {array.shape}; needed: {len(time)} rows, as time_s")
    return time, velocity, torque, angle


def _check_time(bad: int, time: FloatArray) -> None:
    """Refuse a time that the kernel named; -1 is none."""
    if bad >= 0:
        raise DataError(
            f"time_s is {time[bad]!r} s; needed: finite and later than the sample before",
            where=f"sample {bad} of the block",
            fix="sort the samples by time and remove repeated ones",
        )
