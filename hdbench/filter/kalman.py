"""Run, batch and smooth a state-space model: the kernel's public face."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hdbench.errors import DataError
from hdbench.filter.answers import BatchResult, RunResult, SmoothResult
from hdbench.filter.core import Form, kernel_form, kernel_name
from hdbench.filter.layout import state_size
from hdbench.filter.statespace import StateSpace, pack
from hdbench.records import FloatArray

__all__ = ["BatchResult", "RunResult", "SmoothResult", "batch", "new_state", "run", "smooth"]


def new_state(model: StateSpace) -> FloatArray:
    """Return the state of a filter that has seen nothing."""
    return np.zeros(state_size(len(model.blocks)))


def run(
    model: StateSpace,
    state: FloatArray,
    time_s: ArrayLike,
    velocity_rad_s: ArrayLike,
    torque_nm: ArrayLike,
    *,
    angle_rad: ArrayLike | None = None,
    form: Form | None = None,
) -> RunResult:
    r"""Filter the next samples of one trace.

    Notes
    -----
    With F the blocks' transitions into sample k and C the sum of all first states:

    .. math::
        x^- = F x, \; P^- = F P F^T + Q, \; S = R + C P^- C^T, \; e = y - C x^-, \;
        x = x^- + P^- C^T e / S, \; P = P^- - P^- C^T C P^- / S

    A missing or gated sample ends after :math:`P^-`. Splitting a trace changes no bit.
    """
    samples = _samples(time_s, velocity_rad_s, torque_nm, angle_rad)
    n = samples[0].size
    sums = np.zeros(3)
    _check_state(model, state)
    # two blocks, not seven arrays: the system hands out larger pages, and keeps them in the process
    a, b, c, d = np.empty((4, n))
    e, f, g = np.empty((3, n))
    flags = np.empty(n, dtype=np.uint8)
    work = kernel_form(form or kernel_name()).run
    bad = work(pack(model), state, samples, (a, b, c, d, e, f, g), flags, sums)
    if bad >= 0:
        raise _bad_time(samples[0], bad)
    used, logs, squares = sums.tolist()
    return RunResult(a, b, c, d, e, f, g, flags, int(used), logs, squares)


def batch(
    model: StateSpace,
    time_s: ArrayLike,
    velocity_rad_s: ArrayLike,
    torque_nm: ArrayLike,
    *,
    angle_rad: ArrayLike | None = None,
    innovations: bool = False,
    form: Form | None = None,
) -> BatchResult:
    """Filter many traces of one model at once, each with the bits that `run` gives it."""
    time = _array(time_s, 1)
    velocity, torque = _array(velocity_rad_s, 2), _array(torque_nm, 2)
    angle = None if angle_rad is None else _array(angle_rad, 2)
    for array in (velocity, torque, angle):
        if array is not None and array.shape != (time.size, torque.shape[1]):
            raise ValueError(f"found shape {array.shape}; needed {(time.size, torque.shape[1])}")
    filtered = np.empty_like(torque)
    innovation = np.empty_like(torque) if innovations else None
    variance = np.empty_like(torque) if innovations else None
    sums = np.zeros((3, torque.shape[1]))
    samples, outputs = (time, velocity, torque, angle), (filtered, innovation, variance)
    bad = kernel_form(form or kernel_name()).batch(pack(model), samples, outputs, sums)
    if bad >= 0:
        raise _bad_time(time, bad)
    return BatchResult(filtered, innovation, variance, sums[0], sums[1], sums[2])


def smooth(
    model: StateSpace,
    time_s: ArrayLike,
    velocity_rad_s: ArrayLike,
    torque_nm: ArrayLike,
    *,
    angle_rad: ArrayLike | None = None,
    covariance: bool = True,
    form: Form | None = None,
) -> SmoothResult:
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
    samples = _samples(time_s, velocity_rad_s, torque_nm, angle_rad)
    n, nb = samples[0].size, len(model.blocks)
    mean = np.empty((n, nb, 2))
    bands = np.empty((n, nb, 3)) if covariance else None
    expected = np.empty(n)
    work = kernel_form(form or kernel_name()).smooth
    bad = work(pack(model), samples, expected, mean, bands)
    if bad >= 0:
        raise _bad_time(samples[0], bad)
    back = np.argsort(model.kernel_order())
    if not np.array_equal(back, np.arange(nb)):
        mean = mean[:, back]
        bands = None if bands is None else bands[:, back]
    return SmoothResult(mean, bands, expected)


def _array(values: ArrayLike, ndim: int) -> FloatArray:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != ndim:
        raise ValueError(f"found an array of shape {array.shape}; needed: {ndim} dimensions")
    return array


def _samples(
    time_s: ArrayLike, velocity_rad_s: ArrayLike, torque_nm: ArrayLike, angle_rad: ArrayLike | None
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
    time, velocity, torque = (_array(v, 1) for v in (time_s, velocity_rad_s, torque_nm))
    angle = None if angle_rad is None else _array(angle_rad, 1)
    for name, array in (("velocity_rad_s", velocity), ("torque_nm", torque), ("angle", angle)):
        if array is not None and array.size != time.size:
            raise ValueError(f"{name} has {array.size} samples, time_s {time.size}")
    return time, velocity, torque, angle


def _check_state(model: StateSpace, state: FloatArray) -> None:
    needed = state_size(len(model.blocks))
    if state.dtype != np.float64 or state.shape != (needed,) or not state.flags.c_contiguous:
        raise ValueError(f"state has shape {state.shape}; needed {needed} float64 numbers")


def _bad_time(time: FloatArray, bad: int) -> DataError:
    return DataError(
        f"time_s is {time[bad]!r} s; needed: finite and later than the sample before",
        where=f"sample {bad} of the block",
        fix="sort the samples by time and remove repeated ones",
    )
