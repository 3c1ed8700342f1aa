"""Causal convolution of columns with a kernel: shifted sums, blocks or an FFT by its length."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

__all__ = ["DIRECT", "convolution", "transformed"]

# kernels up to the first length are applied by sums of shifted samples, up to the second by
# products of blocks with a band matrix, longer ones by an FFT
_SHORT = 5
DIRECT = 64
_NARROW = 32


def transformed(kernel: FloatArray, samples: int) -> NDArray[np.complex128]:
    """Return the transform of a kernel for a linear convolution with `samples` values.

    Parameters
    ----------
    kernel : ndarray, shape (m,)
        Kernel.
    samples : int
        Length of what it is convolved with.

    Returns
    -------
    ndarray of complex
        Zero-padded to a length at which a circular convolution is a linear one.
    """
    from scipy.fft import rfft

    return np.asarray(rfft(kernel, _padded(samples, len(kernel))))


def _padded(samples: int, kernel: int) -> int:
    from scipy.fft import next_fast_len

    return int(next_fast_len(samples + kernel, real=True))


def convolution(
    kernel: Any, samples: int, spectrum: NDArray[np.complex128] | None = None
) -> Callable[[Any, Any], None]:
    """Return what convolves rows of `samples` values with a kernel into other rows.

    Parameters
    ----------
    kernel : ndarray, shape (m,)
        Kernel, of the precision of the rows.
    samples : int
        Length of the rows.
    spectrum : ndarray of complex or None
        As `transformed` gives it for a long kernel; formed here where None.

    Returns
    -------
    callable
        Called with rows and with what takes the result, both of shape (k, samples).
    """
    if len(kernel) <= _SHORT:
        return lambda rows, out: _shifted(rows, kernel, out)
    if len(kernel) <= DIRECT:
        bands = _bands(kernel)
        return lambda rows, out: _in_blocks(rows, bands, out)
    from scipy.fft import irfft, rfft

    size = _padded(samples, len(kernel))
    response = transformed(kernel, samples) if spectrum is None else spectrum
    response = response.astype(np.result_type(kernel.dtype, np.complex64))

    def convolve(rows: Any, out: Any) -> None:
        part = rfft(rows, size, axis=1)
        part *= response
        out[:] = irfft(part, size, axis=1, overwrite_x=True)[:, :samples]

    return convolve


def _shifted(rows: Any, kernel: Any, out: Any) -> None:
    """Convolve rows with a short kernel as a sum of shifted samples."""
    np.multiply(rows, kernel[0], out=out)
    for lag, weight in enumerate(kernel[1:], 1):
        out[:, lag:] += weight * rows[:, :-lag]


def _bands(kernel: Any) -> tuple[Any, Any]:
    """Return what a block of samples takes from itself and from the block before, (b, b) each."""
    size = _NARROW if len(kernel) <= _NARROW else DIRECT
    lag = np.arange(size) - np.arange(size)[:, None]
    padded = np.concatenate([kernel, np.zeros(2 * size - len(kernel), dtype=kernel.dtype)])
    return np.where(lag >= 0, padded[np.maximum(lag, 0)], 0).astype(kernel.dtype), padded[
        np.maximum(lag + size, 0)
    ]


def _in_blocks(rows: Any, bands: tuple[Any, Any], out: Any) -> None:
    """Convolve rows block by block: a Toeplitz matrix times all blocks at once."""
    size = len(bands[0])
    for row, target in zip(rows, out, strict=True):
        count = -(-len(row) // size)
        blocks = np.zeros((count + 1, size), dtype=row.dtype)
        blocks.reshape(-1)[size : size + len(row)] = row
        done = blocks[1:] @ bands[0]
        done += blocks[:-1] @ bands[1]
        target[:] = done.reshape(-1)[: len(row)]
