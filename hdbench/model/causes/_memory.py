"""Exact recursions over samples for causes that remember: compiled where a compiler was there."""

from __future__ import annotations

from functools import cache
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from hdbench.model.causes import _twins
from hdbench.model.causes._twins import ComplexArray, Number
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

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


@cache
def _compiled() -> ModuleType | None:
    try:
        from hdbench.model.causes import _recursions
    except ImportError:
        return None
    return _recursions


def first_order(decay: NDArray[Number], drive: NDArray[Number]) -> NDArray[Number]:
    """Return what a first-order memory makes of its drive.

    Parameters
    ----------
    decay : ndarray, shape (n_samples,)
        What is kept of the value before, 0 at a start.
    drive : ndarray, shape (n_samples,)
        What is added. Complex numbers, which only uneven samples bring, go the way of NumPy.

    Returns
    -------
    ndarray, shape (n_samples,)
        ``z[k] = decay[k] z[k-1] + drive[k]`` with ``z[-1] = 0``.
    """
    native = _compiled()
    if native is None or np.iscomplexobj(drive):
        return _twins.first_order(decay, drive)
    result = np.empty_like(drive)
    native.first_order(decay, drive, result)
    return result


def second_order(
    above: FloatArray, below: FloatArray, starts: NDArray[np.bool_], values: FloatArray
) -> FloatArray:
    """Return values through (above) / (1, below) in powers of z^-1, at rest at every start."""
    native = _compiled()
    if native is None:
        return _twins.second_order(above, below, starts, values)
    result = np.empty_like(values)
    native.second_order(above, below, starts.view(np.uint8), values, result)
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
    native = _compiled()
    if native is None:
        return _twins.resonance(wave, rate, decay, starts, pole)
    result = np.empty_like(wave)
    parts = [one.view(np.float64) for one in (wave, np.atleast_1d(decay), np.array([pole]), result)]
    native.resonance(parts[0], rate, parts[1], starts.view(np.uint8), parts[2], parts[3])
    return result


def plays(torque: FloatArray, radius: FloatArray, starts: NDArray[np.bool_]) -> FloatArray:
    """Return the sum of play operators, one for each radius, shape (n_samples,).

    Each is moved no farther than needed to lie within its radius of the torque; at a start it is
    the torque.
    """
    native = _compiled()
    if native is None:
        return _twins.plays(torque, radius, starts)
    result = np.empty_like(torque)
    native.plays(torque, radius, starts.view(np.uint8), np.empty_like(radius), result)
    return result
