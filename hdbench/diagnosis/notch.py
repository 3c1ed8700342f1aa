"""Lines over motor order, taken out of a residual before its noise is modelled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.scan import OVERSAMPLE, LineScan
from hdbench.diagnosis.whitened import orthonormal
from hdbench.records.trace import FloatArray

__all__ = ["without_order_lines"]

# power of a line of six standard deviations over the mean background: 6^2 / 2
_LINE_POWER = 18.0
# lines taken out at once, and how often; resolution cells of the running background
_LINES_AT_ONCE = 4
_LINE_ROUNDS = 3
_BACKGROUND_CELLS = 256


def without_order_lines(left: FloatArray, valid: NDArray[np.bool_], scan: LineScan) -> FloatArray:
    """Return a residual without the lines that stand above its order spectrum.

    Parameters
    ----------
    left : ndarray, shape (n,)
        Residual, zero where not valid.
    valid : ndarray of bool, shape (n,)
        Usable samples.
    scan : LineScan
        Scan over motor order.

    Returns
    -------
    ndarray, shape (n,)
        Residual for a noise model: at a speed that varies such a line covers a band of
        frequencies, which an autoregression would take for the colour of the noise.

    Notes
    -----
    A line is a peak of 18 times the local background in power: 6 standard deviations of its
    amplitude. It is taken out with its neighbours one resolution cell to both sides.
    """
    for _ in range(_LINE_ROUNDS):
        power = np.abs(scan.single(left[:, None])[0]) ** 2
        peaks = _strong_peaks(power)
        if not len(peaks):
            break
        cells = np.add.outer(peaks, (-OVERSAMPLE, 0, OVERSAMPLE)).ravel()
        orders = np.unique(scan.single.grid[np.clip(cells, 0, len(power) - 1)])
        phase = 2.0 * np.pi * np.multiply.outer(scan.positions, orders)
        design = np.hstack([np.cos(phase), np.sin(phase)]) * valid[:, None]
        basis = orthonormal(design)
        left = left - basis @ (basis.T @ left)
    return left


def _strong_peaks(power: FloatArray) -> NDArray[np.int64]:
    """Return the strongest local maxima far above the running median of the power."""
    width = _BACKGROUND_CELLS * OVERSAMPLE
    edges = np.arange(0, max(1, len(power) - width // 2), width)
    # the median of an exponential distribution is ln 2 times its mean
    levels = [float(np.median(power[e : e + width])) / np.log(2.0) for e in edges]
    background = np.interp(np.arange(len(power)), edges + width // 2, levels)
    ratio = power / np.maximum(background, np.finfo(float).tiny)
    inner = np.arange(1, len(power) - 1)
    top = (power[inner] >= power[inner - 1]) & (power[inner] > power[inner + 1])
    peaks = inner[top & (ratio[inner] > _LINE_POWER)]
    return np.asarray(peaks[np.argsort(power[peaks])[::-1][:_LINES_AT_ONCE]])
