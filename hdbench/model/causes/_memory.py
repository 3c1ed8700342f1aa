"""Exact recursions over samples for causes that remember, without a Python step per sample."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

ComplexArray = NDArray[np.complex128]
Number = TypeVar("Number", np.float64, np.complex128)

# a decay that changes by less than this share of what is lost per sample is constant: the result
# is within as much of the exact one
_STEADY = 1e-8
# more stretches than these are advanced side by side
_STRETCHES = 64


def remembered(motion: Motion, values: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the samples at which `values` is known, and which of them begin anew."""
    known = motion.valid & np.isfinite(values)
    at = np.flatnonzero(known)
    starts = np.zeros(len(at), dtype=bool)
    if len(at):
        starts[0] = True
    if motion.starts is not None:
        # a start that was lost passes to the next sample that is known
        begun = np.cumsum(motion.starts)[at]
        starts[1:] = np.diff(begun) > 0
    return at, starts


def spread_out(values: FloatArray, at: NDArray[np.intp], n_samples: int) -> FloatArray:
    """Return `values` at the samples `at`, NaN at all others."""
    full = np.full(n_samples, np.nan)
    full[at] = values
    return full


def linear_recursion(decay: NDArray[Number], drive: NDArray[Number]) -> NDArray[Number]:
    """Return z with z[k] = decay[k] z[k-1] + drive[k] and z[-1] = 0, shape (n,).

    A start is a sample with decay 0. Where the decay is constant but for starts this is a filter of
    first order. Else the samples are cut into about sqrt(n) blocks that are
    advanced side by side from 0; what a block inherits is added afterwards.
    """
    n = len(drive)
    starts = decay == 0.0
    runs = stretches(starts)
    if runs is not None and _steady(decay[~starts]):
        return _filtered(decay[~starts][0], drive, runs)
    length = max(1, math.isqrt(n))
    a, f = _blocks(decay, length), _blocks(drive, length)
    z, product = np.empty_like(f), np.empty_like(a)
    value, through = np.zeros_like(f[0]), np.ones_like(a[0])
    for i in range(length):
        value = a[i] * value + f[i]
        through = through * a[i]
        z[i], product[i] = value, through
    carried = np.zeros_like(value)
    for block in range(1, len(carried)):
        carried[block] = product[-1, block - 1] * carried[block - 1] + z[-1, block - 1]
    result: NDArray[Number] = (z + product * carried).T.reshape(-1)[:n]
    return result


def stretches(starts: NDArray[np.bool_]) -> list[slice] | None:
    """Return the stretches of samples that follow each other; None where they are many."""
    begins = np.flatnonzero(starts)
    if len(begins) > _STRETCHES:
        return None
    edges = [0, *(int(at) for at in begins if at > 0), len(starts)]
    return [slice(start, stop) for start, stop in pairwise(edges)]


def even_step(time: FloatArray, starts: NDArray[np.bool_], pole: complex) -> float | None:
    """Return the step in time, s, where a decay exp(pole step) is one and the same; else None."""
    step = np.diff(time)[~starts[1:]]
    if not len(step):
        return None
    change = abs(pole) * float(np.abs(step - step[0]).max())
    lost = 1.0 - abs(np.exp(pole * step[0]))
    return float(step[0]) if change <= _STEADY * lost else None


def _steady(decay: NDArray[Number]) -> bool:
    """Return whether a decay is one and the same to rounding of the time."""
    if not len(decay):
        return False
    return bool(np.abs(decay - decay[0]).max() <= _STEADY * (1.0 - abs(decay[0])))


def _filtered(decay: Number, drive: NDArray[Number], runs: list[slice]) -> NDArray[Number]:
    """Return the recursion of a constant decay, begun anew in every stretch."""
    from scipy.signal import lfilter

    result = np.empty_like(drive)
    for run in runs:
        result[run] = lfilter([1.0], [1.0, -decay], drive[run])
    return result


def play(torque: FloatArray, radius: FloatArray, starts: NDArray[np.bool_]) -> FloatArray:
    """Return the play operator of every radius, shape (n_radii, n_samples).

    p[k] is p[k-1] moved no farther than needed to lie within `radius` of torque[k]; at a start it
    is the torque. Moving is a clamp, and clamps in a row are a clamp: blocks are advanced side by
    side with the clamp so far, and what a block inherits is clamped afterwards.
    """
    n = len(torque)
    length = max(1, math.isqrt(n))
    x = _blocks(torque, length)
    width = np.where(_blocks(starts, length), 0.0, 1.0)
    half = radius[:, None]
    shape = (length, len(radius), x.shape[1])
    low, high = np.empty(shape), np.empty(shape)
    least, most = np.full(shape[1:], -np.inf), np.full(shape[1:], np.inf)
    for i in range(length):
        bottom, top = x[i] - half * width[i], x[i] + half * width[i]
        least = np.minimum(np.maximum(least, bottom), top)
        most = np.minimum(np.maximum(most, bottom), top)
        low[i], high[i] = least, most
    carried = np.full(shape[1:], torque[0] if n else 0.0)
    for block in range(1, shape[2]):
        before = block - 1
        carried[:, block] = np.clip(carried[:, before], low[-1, :, before], high[-1, :, before])
    result = np.minimum(np.maximum(carried, low), high)
    return np.asarray(result.transpose(1, 2, 0).reshape(len(radius), -1)[:, :n])


def _blocks(values: NDArray[np.generic], length: int) -> NDArray[np.generic]:
    """Return `values`, its end repeated, as (length, n_blocks): block b is column b."""
    n_blocks = -(-len(values) // length)
    padded = np.concatenate((values, np.repeat(values[-1:], n_blocks * length - len(values))))
    return np.ascontiguousarray(padded.reshape(n_blocks, length).T)
