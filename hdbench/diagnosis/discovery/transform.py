"""Fourier sums over samples at any positions: turns of a shaft, or time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

# samples spread over this many grid points of a grid 1.5 times finer than needed: with a
# Kaiser-Bessel kernel the error is exp(-pi 8 sqrt(1 - 1/1.5)) = 5e-7 of the largest sum
_WIDTH = 8
_FINER = 1.5


@dataclass(frozen=True, slots=True)
class PhaseTransform:
    """Sums ``sum_n g_n exp(-2 pi i f u_n)`` on a grid of f.

    Parameters
    ----------
    grid : ndarray, shape (n_grid,)
        f: order where u is in turns, frequency in Hz where u is in s.
    spread : sparse matrix of float32, shape (rows, n)
        Spreads samples over the uniform grid.
    size : int
        Length of the FFT.
    first : int
        Index of the first grid point in the FFT.
    correction : ndarray of complex64, shape (n_grid,)
        Divides out kernel and origin.
    """

    grid: FloatArray
    spread: Any
    size: int
    first: int
    correction: NDArray[np.complex64]

    def __call__(self, column: FloatArray) -> NDArray[np.complex64]:
        """Return the sums of a column of shape (n,) as (n_grid,), to single precision."""
        from scipy.fft import rfft

        spread = self.spread @ column.astype(np.float32)
        full = rfft(spread, n=self.size)
        return np.asarray(full[self.first : self.first + len(self.grid)] * self.correction)


def plan_transform(
    positions: FloatArray, grid_step: float, low: float, high: float, factor: float = 1.0
) -> PhaseTransform:
    """Plan the sums for fixed positions.

    References
    ----------
    .. [1] A. H. Barnett, J. Magland, L. af Klinteberg, SIAM J. Sci. Comput. 41 (2019) C479,
       doi:10.1137/18M120885X.
    """
    from scipy.fft import next_fast_len
    from scipy.sparse import csc_array
    from scipy.special import i0

    first, last = max(1, int(np.ceil(low / grid_step))), int(np.floor(high / grid_step))
    index = np.arange(first, last + 1)
    origin = float(positions.min())
    reach = factor * grid_step * float(np.ptp(positions))
    size = int(next_fast_len(max(64, int(np.ceil(2.0 * _FINER * (last + 1) * max(1.0, reach))))))
    place = factor * grid_step * size * (positions - origin) + _WIDTH / 2.0
    left = np.floor(place).astype(np.int32) - _WIDTH // 2 + 1
    beta = np.pi * _WIDTH * (1.0 - 0.5 / _FINER)
    # distance from the sample in half widths, to single precision as the sums are
    away = (2.0 / _WIDTH) * ((left - place)[:, None] + np.arange(_WIDTH))
    weights = i0(np.sqrt(np.maximum(1.0 - away * away, 0.0).astype(np.float32)) * np.float32(beta))
    rows = left[:, None] + np.arange(_WIDTH, dtype=np.int32)
    rows %= size
    n_rows = int(rows.max()) + 1
    # one column per sample, and 32 bits hold any index of a record that fits into memory
    starts = np.arange(0, rows.size + 1, _WIDTH, dtype=np.int32)
    parts = (weights.ravel(), rows.ravel().astype(np.int32), starts)
    spread = csc_array(parts, shape=(n_rows, len(positions)))
    root = np.sqrt(beta**2 - (np.pi * _WIDTH * index / size) ** 2)
    kernel = _WIDTH * np.sinh(root) / root
    turn = np.exp(2j * np.pi * index * _WIDTH / 2.0 / size)
    # back to the true origin of the positions
    turn = turn * np.exp(-2j * np.pi * factor * grid_step * index * origin)
    correction = np.asarray(turn / kernel, dtype=np.complex64)
    return PhaseTransform(
        np.asarray(grid_step * index, dtype=np.float64), spread, size, first, correction
    )
