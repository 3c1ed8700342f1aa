"""The whitened residual space: noise divided out, what is already explained projected out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.noise.convolution import DIRECT, convolution, transformed
from hdbench.diagnosis.noise.gaps import Bridges, bridges
from hdbench.estimation import NoiseModel, run_positions
from hdbench.records.trace import FloatArray

__all__ = ["Space", "Whitener", "make_space", "make_whitener", "orthonormal"]

# directions whose share of the scaled design falls below this are sums of the others
_RANK = 1e-9
# columns that one FFT takes: as many single-precision values as one instruction works on
_SIDE_BY_SIDE = 4


@dataclass(frozen=True, slots=True)
class Whitener:
    """The operator A with ``A e`` white and of unit variance, and its adjoint.

    Parameters
    ----------
    kernel : ndarray, shape (p + 1,)
        ``(1, -a_1, ..., -a_p)``, or the first n samples of a longer response.
    std : float
        Standard deviation of the innovation.
    valid : ndarray of bool, shape (n,)
        Samples that enter.
    used : ndarray of bool, shape (n,)
        Samples of the whitened record: valid with enough valid ones directly before them.

    Notes
    -----
    The transform of a long kernel is formed once and kept in ``spectrum``, a finer one for
    `power_gain` in ``response``, and in ``last`` the columns that `whitened_base` whitened last.
    A long kernel remembers what is left out: there `gaps` bridges it, by the same straight lines
    in the data and in every column. A short one never reaches it from a sample that is used.
    """

    kernel: FloatArray
    std: float
    valid: NDArray[np.bool_]
    used: NDArray[np.bool_]
    spectrum: NDArray[np.complex128] | None = field(init=False, repr=False, default=None)
    response: NDArray[np.complex128] | None = field(init=False, repr=False, default=None)
    gaps: Bridges | None = field(init=False, repr=False, compare=False, default=None)
    last: tuple[FloatArray, FloatArray, FloatArray] | None = field(
        init=False, repr=False, compare=False, default=None
    )

    def __post_init__(self) -> None:
        """Transform a long kernel once."""
        if len(self.kernel) > DIRECT:
            object.__setattr__(self, "spectrum", transformed(self.kernel, len(self.valid)))
            object.__setattr__(self, "gaps", bridges(self.valid, self.reach))

    @property
    def reach(self) -> float:
        """Samples in which a walk moves by as much as their mean is uncertain; at least one."""
        # of noise 1 + (c/k)^2 over half cycles k in n samples the log of the first value is
        # -pi c / 2n, and the walk moves by as much as a mean is uncertain in n / pi c samples
        depth = -2.0 * float(np.log(self.kernel[0]))
        return 1.0 / depth if depth > 0.0 else 1.0

    def apply(self, columns: Any) -> Any:
        """Return A applied to columns of shape (n,) or (n, k); zero where not used.

        Single precision stays single.
        """
        table = columns[:, None] if columns.ndim == 1 else columns
        white = np.empty(table.shape, dtype=table.dtype, order="F")
        self._filter(table, self.valid, white, self.gaps)
        _scale_rows(white, self.used / self.std)
        return white[:, 0] if columns.ndim == 1 else white

    def whitened_base(self, base: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return A applied to columns that stay the same, and these times themselves.

        They are kept until other columns are asked for.
        """
        last = self.last
        if last is None or last[0] is not base:
            white = self.apply(base)
            white.flags.writeable = False
            last = (base, white, white.T @ white)
            object.__setattr__(self, "last", last)
        return last[1], last[2]

    def forget(self) -> None:
        """Let go of the columns that were whitened last."""
        object.__setattr__(self, "last", None)

    def adjoint(self, columns: FloatArray) -> FloatArray:
        """Return A' applied to columns of shape (n,) or (n, k); zero where not valid."""
        table = columns[:, None] if columns.ndim == 1 else columns
        out = np.empty(table.shape, dtype=table.dtype, order="F")
        self._filter(table[::-1], self.used[::-1], out[::-1])
        if self.gaps is not None:
            self.gaps.adjoint(out)
        _scale_rows(out, self.valid / self.std)
        return np.asarray(out[:, 0] if columns.ndim == 1 else out)

    def _filter(
        self, table: Any, seen: NDArray[np.bool_], out: Any, gaps: Bridges | None = None
    ) -> None:
        """Put the causal convolution of every column with the kernel into `out`.

        What is not seen counts as zero, or is bridged by `gaps`. A few columns at a time: what
        stands beside is small.
        """
        kept = None if gaps is not None or seen.all() else seen.astype(table.dtype)
        same = self.spectrum if len(table) == len(self.valid) else None
        convolve = convolution(self.kernel.astype(table.dtype), len(table), same)
        for j in range(0, table.shape[1], _SIDE_BY_SIDE):
            some = table[:, j : j + _SIDE_BY_SIDE]
            part = np.ascontiguousarray((some if gaps is None else gaps.cross(some)).T)
            convolve(part if kept is None else part * kept, out[:, j : j + _SIDE_BY_SIDE].T)

    def power_gain(self, cycles_per_sample: FloatArray) -> NDArray[np.complex128]:
        """Return the frequency response of A, per unit of the noise."""
        if len(self.kernel) <= DIRECT:
            lags = np.arange(len(self.kernel))
            turn = np.exp(-2j * np.pi * np.multiply.outer(cycles_per_sample, lags))
            return np.asarray(turn @ self.kernel / self.std, dtype=np.complex128)
        response = self._long_response()
        axis = np.linspace(0.0, 0.5, len(response))
        folded = np.abs(cycles_per_sample - np.round(cycles_per_sample))
        real = np.interp(folded, axis, response.real)
        imaginary = np.interp(folded, axis, response.imag)
        return np.asarray((real + 1j * imaginary) / self.std, dtype=np.complex128)

    def _long_response(self) -> NDArray[np.complex128]:
        """Return the transform of a long kernel four times finer than its cells, formed once."""
        if self.response is None:
            from scipy.fft import next_fast_len, rfft

            half = next_fast_len(2 * len(self.kernel), real=True)
            object.__setattr__(self, "response", rfft(self.kernel, 2 * half))
        return np.asarray(self.response)


def _scale_rows(table: Any, factor: FloatArray) -> None:
    """Multiply every sample of a table by a factor of its own, in place."""
    table *= factor.astype(table.dtype)[:, None]


def make_whitener(
    noise: NoiseModel, valid: NDArray[np.bool_], starts: NDArray[np.bool_]
) -> Whitener:
    """Return the whitening operator of a noise model on a record.

    Parameters
    ----------
    noise : NoiseModel
        Noise.
    valid, starts : ndarray of bool, shape (n,)
        Usable samples, and where a new stretch begins.

    Returns
    -------
    Whitener
        The first p samples of every stretch only feed the others.
    """
    position = run_positions(valid, starts)
    kernel = np.concatenate([[1.0], -noise.coefficients])
    return Whitener(kernel, noise.innovation_std, valid, position >= noise.order)


def orthonormal(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the span of columns.

    Parameters
    ----------
    columns : ndarray, shape (n, k)
        Columns of any rank.

    Returns
    -------
    ndarray, shape (n, rank)
    """
    gram = columns.T @ columns
    size = np.sqrt(np.diag(gram))
    kept = size > 0.0
    if not kept.any():
        return np.zeros((len(columns), 0))
    scale = np.where(kept, 1.0 / np.where(kept, size, 1.0), 0.0)
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    good = values > _RANK * values[-1]
    return np.asarray(columns @ (scale[:, None] * vectors[:, good] / np.sqrt(values[good])))


@dataclass(frozen=True, slots=True)
class Space:
    """The residual after the explained part was projected out, in whitened units.

    Parameters
    ----------
    whitener : Whitener
        A.
    basis : ndarray, shape (n, q)
        Orthonormal basis of the whitened columns that are explained.
    residual : ndarray, shape (n,)
        ``M A y``, M = I - basis basis'.
    pull : ndarray, shape (n,)
        ``A' M A y``: its product with a column is that column's numerator.
    pull_basis : ndarray, shape (n, q)
        ``A' basis``.
    """

    whitener: Whitener
    basis: FloatArray
    residual: FloatArray
    pull: FloatArray
    pull_basis: FloatArray

    @property
    def n_used(self) -> int:
        """Number of whitened samples."""
        return int(self.whitener.used.sum())

    def project(self, columns: FloatArray) -> FloatArray:
        """Return ``M A columns``, shape (n, k)."""
        white = self.whitener.apply(columns)
        white -= self.basis @ (self.basis.T @ white)
        return np.asarray(white)

    def null_pulls(self, draws: int, rng: np.random.Generator) -> FloatArray:
        """Return ``A' M w`` for white noise w, shape (n, draws)."""
        noise = rng.standard_normal((len(self.residual), draws))
        noise[~self.whitener.used] = 0.0
        noise -= self.basis @ (self.basis.T @ noise)
        return self.whitener.adjoint(noise)


def make_space(
    whitener: Whitener, explained: FloatArray | tuple[FloatArray, ...], response: FloatArray
) -> Space:
    """Return the space of a response with the explained columns projected out.

    Parameters
    ----------
    whitener : Whitener
        Noise.
    explained : ndarray, shape (n, k), or tuple of ndarray
        Baseline, nuisance, accepted causes and their tangents, side by side or part by part: of
        parts the first one is whitened once for a whitener.
    response : ndarray, shape (n,)
        Response, N m.

    Returns
    -------
    Space
    """
    basis = orthonormal(_white_parts(whitener, explained))
    white = whitener.apply(response)
    residual = white - basis @ (basis.T @ white)
    return Space(whitener, basis, residual, whitener.adjoint(residual), whitener.adjoint(basis))


def _white_parts(whitener: Whitener, explained: FloatArray | tuple[FloatArray, ...]) -> FloatArray:
    """Return all explained columns whitened, side by side."""
    if not isinstance(explained, tuple):
        return np.asarray(whitener.apply(explained))
    edges = np.cumsum([0, *(part.shape[1] for part in explained)]).tolist()
    white = np.empty((len(whitener.valid), edges[-1]), order="F")
    white[:, : edges[1]] = whitener.whitened_base(explained[0])[0]
    for part, start, stop in zip(explained[1:], edges[1:], edges[2:], strict=False):
        white[:, start:stop] = whitener.apply(part)
    return white
