"""Lines over motor order and frequency, taken out of a residual before its noise is modelled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.detect.scanplan import OVERSAMPLE, LineScan
from hdbench.diagnosis.noise.whitened import orthonormal
from hdbench.records.trace import FloatArray

__all__ = ["without_lines"]

# power of a line of six standard deviations over the mean background: 6^2 / 2
_LINE_POWER = 18.0
# lines taken out at most; resolution cells of the running background: noise of a pole at 0.9 is a
# hump of twenty cells in 6 s at 200 Hz, and no line
_LINES = 12
_BACKGROUND_CELLS = 32


def without_lines(
    left: FloatArray, valid: NDArray[np.bool_], scans: tuple[LineScan, ...]
) -> FloatArray:
    """Return a residual without the lines that stand above its spectra.

    Parameters
    ----------
    left : ndarray, shape (n,)
        Residual, zero where not valid.
    valid : ndarray of bool, shape (n,)
        Usable samples.
    scans : tuple of LineScan
        Scans; those over motor order and frequency are used.

    Returns
    -------
    ndarray, shape (n,)
        Residual for a noise model: at a speed that varies an order covers a band of frequencies,
        and a tone a band of orders, which an autoregression would take for the colour of the noise.

    Notes
    -----
    A line is a peak of 18 times the local background in power: 6 standard deviations of its
    amplitude. The strongest on any axis goes first, with its neighbours one resolution cell to
    both sides: on the wrong axis the same line is many weak ones.
    """
    axes = [scan for scan in scans if scan.domain != "output-order"]
    for _ in range(_LINES):
        best: tuple[float, LineScan, int] | None = None
        for scan in axes:
            power = np.abs(scan.single(left)) ** 2
            peak = _strongest_peak(power)
            if peak is not None and (best is None or power[peak] > best[0]):
                best = (float(power[peak]), scan, peak)
        if best is None:
            break
        _, scan, peak = best
        cells = peak + OVERSAMPLE * np.arange(-1, 2)
        places = np.unique(scan.single.grid[np.clip(cells, 0, len(scan.single.grid) - 1)])
        phase = 2.0 * np.pi * np.multiply.outer(scan.positions, places)
        design = np.hstack([np.cos(phase), np.sin(phase)]) * valid[:, None]
        basis = orthonormal(design)
        left = left - basis @ (basis.T @ left)
    return left


def _strongest_peak(power: FloatArray) -> int | None:
    """Return the strongest local maximum far above the running median of the power, or None."""
    width = min(_BACKGROUND_CELLS * OVERSAMPLE, len(power))
    whole = len(power) // width
    # the median of an exponential distribution is ln 2 times its mean
    levels = np.median(power[: whole * width].reshape(whole, width), axis=1) / np.log(2.0)
    centres = width * np.arange(whole) + width // 2
    background = np.interp(np.arange(len(power)), centres, levels)
    ratio = power / np.maximum(background, np.finfo(float).tiny)
    inner = np.arange(1, len(power) - 1)
    top = (power[inner] >= power[inner - 1]) & (power[inner] > power[inner + 1])
    peaks = inner[top & (ratio[inner] > _LINE_POWER)]
    return int(peaks[np.argmax(power[peaks])]) if len(peaks) else None
