"""Linear regression with white or coloured noise, a valid mask and effective dof."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.estimation.noise import MAX_AR_ORDER, NoiseModel, fit_noise, whiten
from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray

# largest ratio of singular values of the scaled design that still gives digits to trust
_MAX_CONDITION = 1e8
_ROUNDS = 2


@dataclass(frozen=True, slots=True)
class LinearFit:
    """Coefficients of ``response = design @ coefficients + noise``.

    Parameters
    ----------
    coefficients : ndarray, shape (k,)
        Estimates, unit of the response over that of each column.
    covariance : ndarray, shape (k, k)
        Their covariance.
    dof : float
        Effective degrees of freedom of the covariance, at least 1.
    residual : ndarray, shape (n,)
        Response minus fit; NaN where not used.
    used : ndarray of bool, shape (n,)
        Samples that entered.
    noise : NoiseModel or None
        Noise model of a coloured fit.
    """

    coefficients: FloatArray
    covariance: FloatArray
    dof: float
    residual: FloatArray
    used: NDArray[np.bool_]
    noise: NoiseModel | None = None

    @property
    def n_samples(self) -> int:
        """Number of samples that entered."""
        return int(self.used.sum())

    @property
    def rms(self) -> float:
        """Root mean square of the residual, unit of the response."""
        return float(np.sqrt(np.mean(self.residual[self.used] ** 2)))

    def quantity(self, index: int) -> Quantity:
        """Return one coefficient with its standard uncertainty and dof."""
        std = float(np.sqrt(self.covariance[index, index]))
        return Quantity(float(self.coefficients[index]), std, self.dof)


def _mask(
    design: FloatArray, response: FloatArray, valid: NDArray[np.bool_] | None
) -> NDArray[np.bool_]:
    if design.ndim != 2 or response.shape != (design.shape[0],):
        raise ValueError(
            f"design {design.shape} and response {response.shape} must be (n, k) and (n,)"
        )
    used = np.isfinite(response) & np.isfinite(design).all(axis=1)
    if valid is not None:
        used &= valid
    if not int(used.sum()) > design.shape[1]:
        raise ValueError(
            f"{design.shape[1]} coefficients need more samples than that, found {int(used.sum())}"
        )
    return used


def _solve(design: FloatArray, response: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return least-squares coefficients and the inverse of design' design."""
    scale = np.sqrt(np.einsum("nk,nk->k", design, design))
    if not np.all(scale > 0.0):
        raise ValueError(f"design column {int(np.argmin(scale))} is zero on the samples used")
    _, triangle = np.linalg.qr(np.column_stack([design / scale, response]))
    k = design.shape[1]
    upper = triangle[:k, :k]
    if not np.linalg.cond(upper) < _MAX_CONDITION:
        raise ValueError("the design columns cannot be told apart on the samples used")
    inverse = np.linalg.inv(upper)
    coefficients = inverse @ triangle[:k, k] / scale
    return coefficients, (inverse @ inverse.T) / np.outer(scale, scale)


def ordinary_fit(
    design: FloatArray, response: FloatArray, valid: NDArray[np.bool_] | None = None
) -> LinearFit:
    """Fit by ordinary least squares; the noise is taken as white.

    Parameters
    ----------
    design : ndarray, shape (n, k)
        Columns, any unit.
    response : ndarray, shape (n,)
        Response, any unit.
    valid : ndarray of bool, shape (n,), optional
        Samples that may be used; samples that are not finite never are.

    Returns
    -------
    LinearFit
        With ``covariance = s^2 inv(design' design)``, ``s^2 = rss / dof``, ``dof = n - k``.

    Raises
    ------
    ValueError
        If shapes differ, samples are too few, or columns cannot be told apart.
    """
    used = _mask(design, response, valid)
    coefficients, inverse = _solve(design[used], response[used])
    return _collect(design, response, used, coefficients, inverse, None)


def _collect(
    design: FloatArray,
    response: FloatArray,
    used: NDArray[np.bool_],
    coefficients: FloatArray,
    inverse: FloatArray,
    noise: NoiseModel | None,
) -> LinearFit:
    residual = np.full(len(response), np.nan)
    residual[used] = response[used] - design[used] @ coefficients
    dof = float(used.sum() - design.shape[1])
    variance = float(residual[used] @ residual[used]) / dof
    return LinearFit(coefficients, variance * inverse, dof, residual, used, noise)


def coloured_fit(
    design: FloatArray,
    response: FloatArray,
    valid: NDArray[np.bool_] | None = None,
    *,
    starts: NDArray[np.bool_] | None = None,
    max_order: int = MAX_AR_ORDER,
) -> LinearFit:
    """Fit by generalised least squares with an autoregressive noise found from the residual.

    Parameters
    ----------
    design : ndarray, shape (n, k)
        Columns in time order, any unit.
    response : ndarray, shape (n,)
        Response in time order, any unit.
    valid : ndarray of bool, shape (n,), optional
        Samples that may be used; a gap splits the record.
    starts : ndarray of bool, shape (n,), optional
        Where a new stretch begins, see `run_positions`.
    max_order : int
        Highest order of the autoregression, chosen below it by BIC.

    Returns
    -------
    LinearFit
        With ``covariance = s^2 inv(X~' X~)``, X~ the whitened design and s^2 the mean square of
        the whitened residual.

    Raises
    ------
    ValueError
        If shapes differ, samples are too few, or columns cannot be told apart.

    Notes
    -----
    Residual of ordinary least squares -> noise model -> generalised least squares, twice.
    The dof are ``2 / (2 / (n - k) + v)``: a variance known with the relative variance v has
    ``2 / v`` dof; `NoiseModel.density_variance` gives that of the noise's density. Records
    shorter than about a hundred correlation times of their noise still give intervals that are
    somewhat short, because the fit takes part of the slow noise with it.

    References
    ----------
    .. [1] D. Cochrane, G. H. Orcutt, J. Am. Stat. Assoc. 44 (1949) 32.
    .. [2] P. J. Brockwell, R. A. Davis, Time Series: Theory and Methods, Springer 1991,
       section 8.8, for the covariance of the coefficients.
    """
    first = ordinary_fit(design, response, valid)
    used, residual = first.used, first.residual
    # a residual at rounding level has no colour to be found
    floor = 1e-12 * float(np.max(np.abs(response[used]), initial=0.0))
    if not first.rms > floor:
        return first
    for _ in range(_ROUNDS):
        noise = fit_noise(residual, used, starts=starts, max_order=max_order)
        table = whiten(np.column_stack([design, response]), noise, used, starts=starts)[used]
        coefficients, inverse = _solve(table[:, :-1], table[:, -1])
        residual = np.full(len(response), np.nan)
        residual[used] = response[used] - design[used] @ coefficients
    white = table[:, -1] - table[:, :-1] @ coefficients
    free = float(len(white) - design.shape[1])
    variance = float(white @ white) / free
    dof = max(1.0, 2.0 / (2.0 / free + noise.density_variance))
    return LinearFit(coefficients, variance * inverse, dof, residual, used, noise)
