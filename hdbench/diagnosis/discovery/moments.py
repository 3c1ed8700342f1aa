"""Moments of a joint fit: products in each band about the present residual, and their algebra."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.spectrum import Shapes, Spectrum
from hdbench.records.trace import FloatArray

# relative ridge that keeps columns which are nearly alike from failing
_RIDGE = 1e-10
# a band keeps at least this share of its coefficients as degrees of freedom
_LEAST_DOF = 0.2
# the noise is settled where a further round changes the likelihood by less, nats
_SETTLED = 1e-3
# a spectrum that rises by less than this anywhere has not taken an effect for noise
RISES = 10.0


@dataclass(frozen=True, slots=True)
class Moments:
    """Products of columns with each other and with the residual, band by band.

    Parameters
    ----------
    products : ndarray, shape (n_bands, k (k + 1) / 2)
        Products of columns: the lower triangle of their Gram matrix, row by row.
    right : ndarray, shape (n_bands, k)
        Products of columns with the residual.
    power : ndarray, shape (n_bands,)
        Sum of squares of the residual.
    counts : ndarray, shape (n_bands,)
        Independent coefficients of each band.
    coefficients : ndarray, shape (k,)
        Of the columns, with which the residual was formed.
    penalty : ndarray, shape (k,)
        One over the prior variance; 0 where free.
    expected : ndarray, shape (k,)
        Mean of the prior: 0, or the size of a play or limit, which takes all that is its own.
    moving : ndarray of bool, shape (k,)
        Columns that follow the motion.
    fixed : ndarray, shape (n_bands,)
        Power of what follows the motion and is held fixed.
    """

    products: FloatArray
    right: FloatArray
    power: FloatArray
    counts: FloatArray
    coefficients: FloatArray
    penalty: FloatArray
    expected: FloatArray
    moving: NDArray[np.bool_]
    fixed: FloatArray

    def enlarged(
        self, cross: FloatArray, own: FloatArray, right: FloatArray, moving: bool = False
    ) -> Moments:
        """Return the moments with further columns, whose coefficients are zero."""
        k, extra = self.right.shape[1], own.shape[1]
        below = np.tri(extra, k + extra, k, dtype=bool)
        return Moments(
            np.concatenate([self.products, np.concatenate([cross, own], axis=2)[:, below]], axis=1),
            np.concatenate([self.right, right], axis=1),
            self.power,
            self.counts,
            np.concatenate([self.coefficients, np.zeros(extra)]),
            np.concatenate([self.penalty, np.zeros(extra)]),
            np.concatenate([self.expected, np.zeros(extra)]),
            np.concatenate([self.moving, np.full(extra, moving)]),
            self.fixed,
        )

    def weighted(self, weight: FloatArray) -> FloatArray:
        """Return the Gram matrix of all bands with these weights, shape (k, k)."""
        return np.asarray((weight @ self.products)[_pairs(len(self.coefficients))])

    def left(self, step: FloatArray) -> FloatArray:
        """Return the power left in each band after a step."""
        return self._left(step, _squares(step) @ self.products.T)

    def _left(self, step: FloatArray, squares: FloatArray) -> FloatArray:
        power = self.power - 2.0 * self.right @ step + squares
        return np.maximum(power, 1e-12 * self.power)

    def told(
        self, step: FloatArray, inverse: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return what each band says of a fit after a step.

        That is its trace with the inverse of the normal equations, the power left, and, per
        coefficient, the power of what is modelled and of what moves.
        """
        known = (self.penalty > 0.0) & (self.expected == 0.0)
        free = np.where(known, 0.0, self.coefficients + step)
        vectors = np.stack([step, free, np.where(self.moving, free, 0.0)])
        # one pass over the products, which are many, for all
        sums = np.vstack([_squares(vectors), _trace(inverse)]) @ self.products.T
        squares, whole, moving, trace = sums
        counts = np.maximum(self.counts, 1e-9)
        left = self._left(step, squares)
        return trace, left, (whole + self.fixed) / counts, (moving + self.fixed) / counts


@lru_cache(maxsize=256)
def _pairs(count: int) -> NDArray[np.int64]:
    """Return where the product of each two of so many columns stands, shape (count, count)."""
    low, high = np.sort(np.indices((count, count)), axis=0)
    return np.asarray(high * (high + 1) // 2 + low)


@lru_cache(maxsize=256)
def _triangle(count: int) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Return row and column of each product, and how often it counts in a sum of all."""
    high, low = np.tril_indices(count)
    return high, low, np.where(high == low, 1.0, 2.0)


def _squares(vectors: FloatArray) -> FloatArray:
    """Return the weights of the products in the power of sums of columns."""
    high, low, times = _triangle(vectors.shape[-1])
    return np.asarray(vectors.take(high, -1) * vectors.take(low, -1) * times)


def _trace(lower: FloatArray) -> FloatArray:
    """Return the weights of the products in the trace with a symmetric matrix."""
    high, low, times = _triangle(len(lower))
    return np.asarray(lower.ravel().take(high * len(lower) + low) * times)


def packed(gram: FloatArray, kept: NDArray[np.int64]) -> FloatArray:
    """Return the lower triangles of Gram matrices of some columns, row by row: each once."""
    k = gram.shape[1]
    high, low, _ = _triangle(len(kept))
    return np.asarray(gram.reshape(len(gram), k * k).take(kept[high] * k + kept[low], 1))


@dataclass(frozen=True, slots=True)
class Solved:
    """A joint fit.

    Parameters
    ----------
    likelihood : float
        Log of the likelihood, coefficients with a prior integrated out, nats.
    spectrum : Spectrum
        Noise.
    step : ndarray, shape (k,)
        Change of the coefficients.
    information : ndarray, shape (k, k)
        Weighted Gram matrix with the penalty.
    """

    likelihood: float
    spectrum: Spectrum
    step: FloatArray
    information: FloatArray


def solve(
    moments: Moments,
    shapes: Shapes,
    start: Spectrum,
    *,
    rounds: int = 2,
    anew: bool = False,
    reference: Spectrum | None = None,
) -> Solved:
    """Return coefficients and spectrum, fitted in turn, in so many rounds or until they settle.

    Notes
    -----
    ``-1/2 [sum n_b ln S_b + Q + ln det(form part given the free part) + ln det M(S) / M(S_0)]``, Q
    the weighted sum of squares with the penalty, M the information on the free coefficients. The
    last term keeps the noise from vanishing where many columns explain everything: a band loses
    the degrees of freedom that its columns take.
    """
    spectrum, held = start, reference or start
    for _ in range(rounds):
        normal, right = normal_equations(moments, spectrum)
        step = normal.solution(right)
        counts = np.maximum(moments.counts, 1e-9)
        taken, left, *modelled = moments.told(step, normal.inverse())
        dof = np.clip(counts - taken / spectrum.power, _LEAST_DOF * counts, counts)
        amounts = None if anew else spectrum.amounts
        before, spectrum = spectrum, shapes.fit(left / dof, dof, amounts, *modelled)
        # the likelihood is flat at its best: it changes by the square
        if moments.counts @ np.log(spectrum.power / before.power) ** 2 < 4.0 * _SETTLED:
            break
    normal, right = normal_equations(moments, spectrum)
    step = normal.solution(right)
    total = moments.coefficients + step - moments.expected
    quadratic = float(np.sum(moments.left(step) / spectrum.power))
    quadratic += float(total @ (moments.penalty * total))
    logs = float(moments.counts @ np.log(spectrum.power))
    free = moments.penalty <= 0.0
    width = 0.0
    if free.any() and spectrum is not held:
        then = moments.weighted(1.0 / held.power)[np.ix_(free, free)]
        width = normal.log_det(free) - Normal.of(then).log_det()
    occam = normal.occam(moments.penalty)
    likelihood = -0.5 * (logs + quadratic + occam + width)
    return Solved(likelihood, spectrum, step, normal.matrix)


def among(gram: FloatArray, kept: NDArray[np.bool_]) -> FloatArray:
    """Return the products of some columns among themselves, shape (n_bands, n_kept, n_kept)."""
    k, places = len(kept), np.flatnonzero(kept)
    flat = (places[:, None] * k + places).ravel()
    # one pass over flat rows: several times faster than one axis after the other
    return gram.reshape(len(gram), k * k).take(flat, 1).reshape(-1, len(places), len(places))


def quick_likelihood(
    weighted: FloatArray, right: FloatArray, penalty: FloatArray, kept: NDArray[np.bool_]
) -> float:
    """Return what a fit of some columns gains over none of them in a noise that stays, nats.

    `weighted` and `right` are the products of all columns with each other and with the torque.
    """
    normal = Normal.of(weighted[np.ix_(kept, kept)] + np.diag(penalty[kept]))
    quadratic = float(right[kept] @ normal.solution(right[kept]))
    return 0.5 * (quadratic - normal.occam(penalty[kept]))


def inverse(information: FloatArray) -> FloatArray:
    """Return the inverse of an information matrix; zero for empty columns."""
    scale = inverse_scale(np.diag(information))
    scaled = information * scale * scale[:, None]
    scaled.flat[:: len(scaled) + 1] += np.where(scale > 0.0, _RIDGE, 1.0)
    return np.asarray(np.linalg.inv(scaled) * scale * scale[:, None])


def solve_best(moments: Moments, shapes: Shapes, start: Spectrum, *, rounds: int = 2) -> Solved:
    """Return the likelier of two fits: from the first spectrum, and from one that does not rise.

    A spectrum that has taken an effect for slow noise gives it no weight, and keeps it: where power
    rises towards 0 Hz, the fit is tried from as much noise there as higher up, too.
    """
    first = solve(moments, shapes, start, rounds=rounds)
    even = shapes.even(start.power)
    if float(np.max(start.power / even)) < RISES:
        return first
    flat = shapes.fit(even, moments.counts)
    other = solve(moments, shapes, flat, rounds=rounds + 3, reference=start)
    return other if other.likelihood > first.likelihood else first


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal equations: their matrix, one over the root of its diagonal, and its Cholesky factor.

    Empty columns have a coefficient of zero.
    """

    matrix: FloatArray
    scale: FloatArray
    factor: FloatArray

    @classmethod
    def of(cls, matrix: FloatArray) -> Normal:
        """Return the equations of a matrix."""
        scale = inverse_scale(np.diag(matrix))
        return cls(matrix, scale, _cholesky(matrix, scale))

    def solution(self, right: FloatArray) -> FloatArray:
        """Return the coefficients for a right side."""
        from scipy.linalg.lapack import dpotrs

        if not len(right):
            return right
        return np.asarray(self.scale * dpotrs(self.factor, self.scale * right, lower=1)[0])

    def inverse(self) -> FloatArray:
        """Return the lower triangle of the inverse of the matrix; zero for empty columns."""
        from scipy.linalg.lapack import dpotri

        if not len(self.scale):
            return self.matrix
        lower = dpotri(self.factor, lower=1)[0]
        return np.asarray(lower * self.scale * self.scale[:, None])

    def log_det(self, some: NDArray[np.bool_] | None = None) -> float:
        """Return ln det of the matrix, or of that of some columns, without empty ones."""
        factor, scale = self.factor, self.scale
        if some is not None and not some.all():
            scale = scale[some]
            factor = _cholesky(self.matrix[np.ix_(some, some)], scale)
        full = scale > 0.0
        return 2.0 * float(np.log(np.diag(factor)).sum() - np.log(scale[full]).sum())

    def occam(self, penalty: FloatArray) -> float:
        """Return ln det of the part with a prior, given the free part, less that of the prior."""
        held = penalty > 0.0
        if not held.any():
            return 0.0
        free = self.log_det(~held) if (~held).any() else 0.0
        return self.log_det() - free - float(np.log(penalty[held]).sum())


def _cholesky(matrix: FloatArray, scale: FloatArray) -> FloatArray:
    scaled = matrix * scale * scale[:, None]
    scaled.flat[:: len(scaled) + 1] += np.where(scale > 0.0, _RIDGE, 1.0)
    return np.asarray(np.linalg.cholesky(scaled), dtype=np.float64)


def normal_equations(moments: Moments, spectrum: Spectrum) -> tuple[Normal, FloatArray]:
    """Return the normal equations of a fit in a noise, and their right side."""
    weight = 1.0 / spectrum.power
    matrix = moments.weighted(weight)
    matrix.flat[:: len(matrix) + 1] += moments.penalty
    right = weight @ moments.right
    right -= moments.penalty * (moments.coefficients - moments.expected)
    return Normal.of(matrix), right


def inverse_scale(diagonal: FloatArray) -> FloatArray:
    """Return one over the root of a diagonal; 0 where a column is empty."""
    largest = float(diagonal.max(initial=0.0))
    full = diagonal > 1e-24 * largest
    return np.where(full, 1.0 / np.sqrt(np.where(full, diagonal, 1.0)), 0.0)
