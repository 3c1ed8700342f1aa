"""Recursions over samples in NumPy, for installations without the compiled ones."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

ComplexArray = NDArray[np.complex128]
Number = TypeVar("Number", np.float64, np.complex128)


def first_order(decay: NDArray[Number], drive: NDArray[Number]) -> NDArray[Number]:
    """Return z with z[k] = decay[k] z[k-1] + drive[k] and z[-1] = 0, shape (n,).

    The samples are cut into about sqrt(n) blocks that are advanced side by side from 0; what a
    block inherits is added afterwards.
    """
    n = len(drive)
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


def second_order(
    above: FloatArray, below: FloatArray, starts: NDArray[np.bool_], values: FloatArray
) -> FloatArray:
    """Return a filter of second order, at rest at the value of every start."""
    from scipy.signal import lfilter, lfilter_zi

    bottom = np.concatenate(([1.0], below))
    still = lfilter_zi(above, bottom)
    edges = [*np.flatnonzero(starts), len(values)]
    result = np.empty_like(values)
    for first, last in pairwise(edges):
        part = values[first:last]
        result[first:last] = lfilter(above, bottom, part, zi=still * part[0])[0]
    return result


def resonance(
    wave: ComplexArray,
    rate: FloatArray,
    decay: ComplexArray,
    starts: NDArray[np.bool_],
    pole: complex,
) -> ComplexArray:
    """Return a wave exp(i phase) after both poles: exact for a phase linear between samples."""
    decay = np.where(starts, 0.0, decay)
    before = np.concatenate((wave[:1], wave[:-1]))
    upper = first_order(decay, (wave - decay * before) / (1j * rate - pole))
    decay, mirrored = decay.conj(), pole.conjugate()
    lower = first_order(decay, (wave - decay * before) / (1j * rate - mirrored))
    return np.asarray((upper - lower) * (abs(pole) ** 2 / (pole - mirrored)))


def plays(torque: FloatArray, radius: FloatArray, starts: NDArray[np.bool_]) -> FloatArray:
    """Return the sum of play operators, one for each radius, shape (n,).

    Moving no farther than needed is a clamp, and clamps in a row are a clamp: blocks are advanced
    side by side with the clamp so far, and what a block inherits is clamped afterwards.
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
    result = np.minimum(np.maximum(carried, low), high).sum(axis=1)
    return np.asarray(result.T.reshape(-1)[:n])


def _blocks(values: NDArray[np.generic], length: int) -> NDArray[np.generic]:
    """Return `values`, its end repeated, as (length, n_blocks): block b is column b."""
    n_blocks = -(-len(values) // length)
    padded = np.concatenate((values, np.repeat(values[-1:], n_blocks * length - len(values))))
    return np.ascontiguousarray(padded.reshape(n_blocks, length).T)
