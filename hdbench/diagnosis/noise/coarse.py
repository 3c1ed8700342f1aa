"""What slow, speed-bound and load-bound effects are made of: a noise model must not see it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.curves import bin_edges, equal_bins
from hdbench.diagnosis.noise.whitened import orthonormal
from hdbench.records.trace import FloatArray

__all__ = ["coarse_basis", "noise_width"]

# bins of speed, blocks of time, and twice the output orders that the noise must not swallow; fewer
# on short records: three directions in 300 samples take a hundredth of the noise with them
_COARSE = 16
_COARSE_LEAST = 4
_COARSE_SAMPLES = 300
# levels are apart by so many standard deviations of the fast noise of what they are levels of
_HOPS = 10.0
_LEAST_KNOTS = 2


def coarse_basis(record: Record) -> NDArray[np.float32]:
    """Return what slow and speed-bound effects can be made of, orthonormal.

    Curves over 16 levels of speed and 8 of the measured load in each direction, means over 16
    blocks of time, and output orders 1 to 8; down to a quarter of these on records below 4800
    samples. An autoregression that sees such effects takes them for noise with a long memory and
    whitens them away; without some fifty of many thousand directions it still sees all colour that
    it can describe.

    Parameters
    ----------
    record : Record
        Record.

    Returns
    -------
    ndarray of float32, shape (n_samples, k)
        Zero where not valid. Single precision leaves a ten-millionth of what it takes out.
    """
    motion, valid = record.motion, record.valid
    count = int(np.clip(int(valid.sum()) // _COARSE_SAMPLES, _COARSE_LEAST, _COARSE))
    speed = np.where(valid, motion.velocity_rad_s, 0.0)
    parts = [np.ones((len(valid), 1)), _hats(speed, valid, count)]
    parts += [mask[:, None].astype(np.float64) for mask in equal_bins(motion.time_s, valid, count)]
    if motion.load_torque_nm is not None:
        levels = _hats(np.where(valid, motion.applied_nm, 0.0), valid, count // 2)
        turning = np.clip(speed / max(noise_width(speed, valid), 1e-9), -1.0, 1.0)
        parts += [levels, levels * turning[:, None]]
    for order in range(1, count // 2 + 1):
        angle = order * np.where(valid, motion.output_angle_rad, 0.0)
        parts.append(np.column_stack([np.cos(angle), np.sin(angle)]))
    table = np.hstack(parts)
    table[~valid] = 0.0
    return orthonormal(table).astype(np.float32)


def noise_width(values: FloatArray, valid: NDArray[np.bool_]) -> float:
    """Return how far two levels must be apart for noise not to hop between them.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Channel.
    valid : ndarray of bool, shape (n,)
        Samples that count.

    Returns
    -------
    float
        Ten standard deviations of its fast noise, its own unit.
    """
    steps = np.abs(np.diff(values[valid]))
    # the median of the difference of two normal values is 0.95 of their standard deviation
    return _HOPS * float(np.median(steps)) / 0.95 if len(steps) else 0.0


def _hats(values: FloatArray, valid: NDArray[np.bool_], count: int) -> FloatArray:
    """Return what a curve over values can be made of: it bends at levels of equal shares.

    A table of bins would jump wherever noise carries a sample across an edge, and the noise model
    would take these jumps, of the size of what is not found yet, for white noise.
    """
    edges, apart = bin_edges(values[valid], count), noise_width(values, valid)
    knots = [float(edge) for edge in edges[:1]]
    for edge in edges[1:]:
        if edge - knots[-1] > apart:
            knots.append(float(edge))
    if len(knots) < _LEAST_KNOTS:
        return np.zeros((len(values), 0))
    unit = np.eye(len(knots))
    return np.column_stack([np.interp(values, knots, row) for row in unit])
