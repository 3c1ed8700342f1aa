"""Moments of a joint fit: products in each band about the present residual, and their algebra."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
    gram : ndarray, shape (n_bands, k, k)
        Products of columns.
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
    moving : ndarray of bool, shape (k,)
        Columns that follow the motion.
    fixed : ndarray, shape (n_bands,)
        Power of what follows the motion and is held fixed.
    """

    gram: FloatArray
    right: FloatArray
    power: FloatArray
    counts: FloatArray
    coefficients: FloatArray
    penalty: FloatArray
    moving: NDArray[np.bool_]
    fixed: FloatArray

    def enlarged(
        self, cross: FloatArray, own: FloatArray, right: FloatArray, moving: bool = False
    ) -> Moments:
        """Return the moments with further columns, whose coefficients are zero."""
        k, extra = self.gram.shape[1], own.shape[1]
        gram = np.empty((len(self.gram), k + extra, k + extra))
        gram[:, :k, :k] = self.gram
        gram[:, k:, :k] = cross
        gram[:, :k, k:] = np.swapaxes(cross, 1, 2)
        gram[:, k:, k:] = own
        return Moments(
            gram,
            np.concatenate([self.right, right], axis=1),
            self.power,
            self.counts,
            np.concatenate([self.coefficients, np.zeros(extra)]),
            np.concatenate([self.penalty, np.zeros(extra)]),
            np.concatenate([self.moving, np.full(extra, moving)]),
            self.fixed,
        )

    def without(self, dropped: NDArray[np.bool_]) -> Moments:
        """Return the moments where some columns are taken out, and their part is residual again."""
        kept, back = ~dropped, np.where(dropped, self.coefficients, 0.0)
        right, power = self.right, self.power
        if back.any():
            moved = self.gram @ back
            right, power = right + moved, power + 2.0 * right @ back + moved @ back
        return Moments(
            among(self.gram, kept),
            right[:, kept],
            power,
            self.counts,
            self.coefficients[kept],
            self.penalty[kept],
            self.moving[kept],
            self.fixed,
        )

    def with_penalty(self, penalty: FloatArray) -> Moments:
        """Return the same with another prior."""
        return replace(self, penalty=penalty)

    def left(self, step: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the power left after a step; per coefficient what is modelled, and what moves."""
        free = np.where(self.penalty > 0.0, 0.0, self.coefficients + step)
        moving = np.where(self.moving, free, 0.0)
        vectors = np.stack([step, free, moving], axis=1)
        n_bands, k = self.right.shape
        products = (self.gram.reshape(n_bands * k, k) @ vectors).reshape(n_bands, k, 3)
        squares = np.einsum("bki,ki->bi", products, vectors)
        power = self.power - 2.0 * self.right @ step + squares[:, 0]
        counts = np.maximum(self.counts, 1e-9)
        return (
            np.maximum(power, 1e-12 * self.power),
            (squares[:, 1] + self.fixed) / counts,
            (squares[:, 2] + self.fixed) / counts,
        )


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
        step, information = _normal(moments, spectrum)
        taken = moments.gram.reshape(len(moments.counts), -1) @ inverse(information).ravel()
        counts = np.maximum(moments.counts, 1e-9)
        dof = np.clip(counts - taken / spectrum.power, _LEAST_DOF * counts, counts)
        amounts = None if anew else spectrum.amounts
        power, *modelled = moments.left(step)
        before, spectrum = spectrum, shapes.fit(power / dof, dof, amounts, *modelled)
        # the likelihood is flat at its best: it changes by the square
        if moments.counts @ np.log(spectrum.power / before.power) ** 2 < 4.0 * _SETTLED:
            break
    step, information = _normal(moments, spectrum)
    power = moments.left(step)[0]
    total = moments.coefficients + step
    quadratic = float(np.sum(power / spectrum.power) + total @ (moments.penalty * total))
    logs = float(moments.counts @ np.log(spectrum.power))
    free = moments.penalty <= 0.0
    width = _log_det(information[np.ix_(free, free)]) if free.any() else 0.0
    if free.any() and spectrum is not held:
        width -= _log_det(_weighted(among(moments.gram, free), held))
    else:
        width = 0.0
    likelihood = -0.5 * (logs + quadratic + _occam(information, moments.penalty) + width)
    return Solved(likelihood, spectrum, step, information)


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
    information = weighted[np.ix_(kept, kept)] + np.diag(penalty[kept])
    quadratic = float(right[kept] @ _solution(information, right[kept]))
    return 0.5 * (quadratic - _occam(information, penalty[kept]))


def weighted_products(moments: Moments, spectrum: Spectrum) -> tuple[FloatArray, FloatArray]:
    """Return the products of columns with each other, and with the torque, weighed by a noise."""
    matrix = _weighted(moments.gram, spectrum)
    return matrix, (1.0 / spectrum.power) @ moments.right + matrix @ moments.coefficients


def _weighted(gram: FloatArray, spectrum: Spectrum) -> FloatArray:
    """Return the products of columns, weighed by a noise."""
    k = gram.shape[1]
    return np.asarray(((1.0 / spectrum.power) @ gram.reshape(len(gram), -1)).reshape(k, k))


def inverse(information: FloatArray) -> FloatArray:
    """Return the inverse of an information matrix; zero for empty columns."""
    scale = inverse_scale(np.diag(information))
    scaled = information * np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] += np.where(scale > 0.0, _RIDGE, 1.0)
    return np.asarray(np.linalg.inv(scaled) * np.outer(scale, scale))


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


def _normal(moments: Moments, spectrum: Spectrum) -> tuple[FloatArray, FloatArray]:
    """Return the step and the information."""
    weight = 1.0 / spectrum.power
    matrix = _weighted(moments.gram, spectrum)
    matrix[np.diag_indices_from(matrix)] += moments.penalty
    right = weight @ moments.right - moments.penalty * moments.coefficients
    return _solution(matrix, right), matrix


def _solution(information: FloatArray, right: FloatArray) -> FloatArray:
    """Return the coefficients of normal equations; zero for empty columns."""
    scale = inverse_scale(np.diag(information))
    scaled = information * np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] += np.where(scale > 0.0, _RIDGE, 1.0)
    return np.asarray(scale * np.linalg.solve(scaled, scale * right))


def inverse_scale(diagonal: FloatArray) -> FloatArray:
    """Return one over the root of a diagonal; 0 where a column is empty."""
    largest = float(diagonal.max(initial=0.0))
    full = diagonal > 1e-24 * largest
    return np.where(full, 1.0 / np.sqrt(np.where(full, diagonal, 1.0)), 0.0)


def _occam(information: FloatArray, penalty: FloatArray) -> float:
    """Return ln det of the part with a prior, given the free part, less that of the prior."""
    held = penalty > 0.0
    if not held.any():
        return 0.0
    whole = _log_det(information)
    free = _log_det(information[np.ix_(~held, ~held)]) if (~held).any() else 0.0
    return whole - free - float(np.log(penalty[held]).sum())


def _log_det(matrix: FloatArray) -> float:
    scale = inverse_scale(np.diag(matrix))
    full = scale > 0.0
    scaled = (matrix * np.outer(scale, scale))[np.ix_(full, full)]
    scaled[np.diag_indices_from(scaled)] += _RIDGE
    return float(np.linalg.slogdet(scaled)[1] - 2.0 * np.log(scale[full]).sum())
