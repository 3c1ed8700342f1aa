"""Exact recursions over samples for causes that remember."""

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


def even_step(time: FloatArray, starts: NDArray[np.bool_], pole: complex) -> float | None:
    """Return the step in time, s, where a decay exp(pole step) is one and the same; else None."""
    step = np.diff(time)[~starts[1:]]
    if not len(step):
        return None
    change = abs(pole) * float(np.abs(step - step[0]).max())
    lost = 1.0 - abs(np.exp(pole * step[0]))
    return float(step[0]) if change <= _STEADY * lost else None


def first_order(decay: NDArray[Number], drive: NDArray[Number]) -> NDArray[Number]:
    """Return what a first-order memory makes of its drive.

    Parameters
    ----------
    decay : ndarray, shape (n_samples,)
        What is kept of the value before, 0 at a start.
    drive : ndarray, shape (n_samples,)
        What is added.

    Returns
    -------
    ndarray, shape (n_samples,)
        ``z[k] = decay[k] z[k-1] + drive[k]`` with ``z[-1] = 0``.
    """
    from scipy.linalg.lapack import dgtsv, zgtsv

    n = len(drive)
    if n < 2:
        return drive.copy()
    # a matrix of two diagonals, solved from the first sample on: the recursion itself
    solve = zgtsv if np.iscomplexobj(drive) else dgtsv
    result: NDArray[Number] = solve(-decay[1:], np.ones(n), np.zeros(n - 1), drive)[3]
    return result


def second_order(
    above: FloatArray, below: FloatArray, starts: NDArray[np.bool_], values: FloatArray
) -> FloatArray:
    """Return values through (above) / (1, below) in powers of z^-1, at rest at every start."""
    from scipy.signal import sosfilt

    section = np.array([[*above, 1.0, *below]])
    gain = (above[0] + above[1] + above[2]) / (1.0 + below[0] + below[1])
    second = above[2] - below[1] * gain
    still = np.array([[above[1] - below[0] * gain + second, second]])
    result = np.empty_like(values)
    for first, last in pairwise([*np.flatnonzero(starts), len(values)]):
        part = values[first:last]
        result[first:last] = sosfilt(section, part, zi=still * part[0])[0]
    return result


def resonance(
    wave: ComplexArray,
    rate: FloatArray,
    decay: ComplexArray,
    starts: NDArray[np.bool_],
    pole: complex,
) -> ComplexArray:
    """Return a wave exp(i phase) after a resonance: exact for a phase linear between samples.

    `decay` is exp(pole step) of every sample, or one for all.
    """
    kept = np.where(starts, 0.0, decay)
    before = np.concatenate((wave[:1], wave[:-1]))
    above = _remembering(decay, _driven(wave, before, kept, rate, pole), starts)
    below = _remembering(
        decay.conj(), _driven(wave, before, kept.conj(), rate, pole.conjugate()), starts
    )
    scale = 0.5 * (pole.real * pole.real + pole.imag * pole.imag) / pole.imag
    result = np.empty_like(wave)
    # the difference over 2 i times the imaginary part of the pole
    result.real = scale * (below.imag - above.imag) * -1.0
    result.imag = scale * (below.real - above.real)
    return result


def _driven(
    wave: ComplexArray, before: ComplexArray, decay: ComplexArray, rate: FloatArray, pole: complex
) -> ComplexArray:
    """Return (wave - decay before) / (i rate - pole), part by part."""
    real = wave.real - (decay.real * before.real - decay.imag * before.imag)
    imag = wave.imag - (decay.real * before.imag + decay.imag * before.real)
    away = rate - pole.imag
    over = 1.0 / (pole.real * pole.real + away * away)
    result = np.empty_like(wave)
    result.real = (away * imag - pole.real * real) * over
    result.imag = (-pole.real * imag - away * real) * over
    return result


def _remembering(
    decay: ComplexArray, drive: ComplexArray, starts: NDArray[np.bool_]
) -> ComplexArray:
    """Return `first_order` of a decay for each sample, or of one for all."""
    from scipy.signal import lfilter

    if len(decay) > 1:
        return first_order(np.where(starts, 0.0, decay), drive)
    result = np.empty_like(drive)
    for first, last in pairwise([*np.flatnonzero(starts), len(drive)]):
        result[first:last] = lfilter((1.0,), (1.0, -decay[0]), drive[first:last])
    return result


def plays(torque: FloatArray, radius: FloatArray, starts: NDArray[np.bool_]) -> FloatArray:
    """Return the sum of play operators, one for each radius.

    Each is moved no farther than needed to lie within its radius of the torque; at a start it is
    the torque. Moving no farther than needed is a clamp, and clamps in a row are a clamp: blocks of
    samples are advanced side by side, first with the clamp so far, which says what each block
    inherits, then with that.
    """
    n = len(torque)
    length = max(1, math.isqrt(n))
    x, width = _blocks(torque, length), np.where(_blocks(starts, length), 0.0, 1.0)
    half, count = radius[:, None], x.shape[1]
    least, most = np.full((len(radius), count), -np.inf), np.full((len(radius), count), np.inf)
    for at, wide in zip(x, width, strict=True):
        bottom, top = at - half * wide, at + half * wide
        least = np.minimum(np.maximum(least, bottom), top)
        most = np.minimum(np.maximum(most, bottom), top)
    held = np.full((len(radius), count), torque[0] if n else 0.0)
    for k in range(1, count):
        held[:, k] = np.minimum(np.maximum(held[:, k - 1], least[:, k - 1]), most[:, k - 1])
    total = np.empty_like(x)
    for k, (at, wide) in enumerate(zip(x, width, strict=True)):
        held = np.minimum(np.maximum(held, at - half * wide), at + half * wide)
        total[k] = held.sum(axis=0)
    return np.asarray(total.T.reshape(-1)[:n])


def _blocks(values: NDArray[np.generic], length: int) -> NDArray[np.generic]:
    """Return `values`, its end repeated, as (length, n_blocks): block b is column b."""
    n_blocks = -(-len(values) // length)
    padded = np.concatenate((values, np.repeat(values[-1:], n_blocks * length - len(values))))
    return np.ascontiguousarray(padded.reshape(n_blocks, length).T)
