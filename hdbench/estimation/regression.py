"""Least squares with white or coloured noise: fits, noise of autoregressive form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray

MAX_AR_ORDER = 30


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Noise as an autoregression driven by white noise.

    Notes
    -----
    ``e(k) = sum_i a_i e(k - i) + w(k)``, w white with standard deviation ``innovation_std``.
    """

    # entry j, of shape (j,), predicts a sample from the j samples before it, newest first. The last
    # entry is the model; the lower ones start a record without losing samples
    predictors: tuple[FloatArray, ...]
    # shape (order + 1,): Standard deviation of the error of each predictor, unit of the noise,
    # above zero
    stds: FloatArray
    # samples that the model was fitted to
    n_samples: int

    @property
    def order(self) -> int:
        """Order p of the autoregression."""
        return len(self.predictors) - 1

    @property
    def coefficients(self) -> FloatArray:
        """Coefficients a_1 ... a_p."""
        return self.predictors[-1]

    @property
    def innovation_std(self) -> float:
        """Standard deviation of the innovation w, unit of the noise."""
        return float(self.stds[-1])

    @property
    def density_variance(self) -> float:
        """Relative variance of the spectral density, at the frequency where it is known least.

        Notes
        -----
        With ``A(w) = 1 - sum a_k exp(-i w k)`` and ``g_k = d ln S / d a_k = 2 Re(exp(-i w k) /
        A(w))`` it is ``g' C g``, ``C = std^2 inv(Gamma) / n`` the covariance of the coefficients,
        Gamma that of p neighbouring samples; the largest of 65 frequencies. For a white noise 0.
        """
        p = self.order
        if p == 0:
            return 0.0
        root = np.zeros((p, p))
        for j in range(p):
            root[j, j] = 1.0
            root[j, :j] = -self.predictors[j][::-1]
            root[j] /= self.stds[j]
        # row j of root is the whitened sample j of a run: root' root = inv(Gamma)
        turn = np.exp(-1j * np.outer(np.linspace(0.0, np.pi, 65), np.arange(1, p + 1)))
        slope = 2.0 * np.real(turn / (1.0 - turn @ self.coefficients)[:, None])
        spread = (slope @ root.T) * self.innovation_std
        return float(np.max(np.einsum("wk,wk->w", spread, spread))) / self.n_samples


def run_positions(
    valid: NDArray[np.bool_], starts: NDArray[np.bool_] | None = None
) -> NDArray[np.int64]:
    """Count the valid samples that directly precede each sample.

    Parameters
    ----------
    valid : ndarray of bool, shape (n,)
        Samples that can be used.
    starts : ndarray of bool, shape (n,), optional
        True where a sample does not follow its predecessor (a gap in time, a new stretch).

    Returns
    -------
    ndarray of int64, shape (n,)
        0 at the first sample of a run, 1 at the next, ...; -1 where a sample is not valid.
    """
    index = np.arange(len(valid))
    first = valid.copy()
    first[1:] &= ~valid[:-1]
    if starts is not None:
        first |= starts & valid
    begin = np.maximum.accumulate(np.where(first, index, 0))
    return np.where(valid, index - begin, -1)


def fit_noise(
    residual: FloatArray,
    valid: NDArray[np.bool_] | None = None,
    *,
    starts: NDArray[np.bool_] | None = None,
    max_order: int = MAX_AR_ORDER,
) -> NoiseModel:
    """Fit an autoregression to a residual; the order is chosen by BIC.

    Parameters
    ----------
    residual : ndarray, shape (n,)
        Residual, any unit; its mean is taken as zero.
    valid : ndarray of bool, shape (n,), optional
        Samples that can be used; all finite ones without it.
    starts : ndarray of bool, shape (n,), optional
        Where a new stretch begins, see `run_positions`.
    max_order : int
        Highest order tried, at least 0.

    Returns
    -------
    NoiseModel

    Raises
    ------
    ValueError
        If fewer than four samples are valid or the residual is zero throughout.

    Notes
    -----
    Sinusoids above six standard deviations are taken out first, so that the noise model does not
    swallow what an analysis is looking for. Burg's recursion over every run of valid samples at
    once gives all orders; BIC is ``n ln(std_p^2) + p ln(n)``. Cost O(n max_order).

    References
    ----------
    .. [1] J. P. Burg, Maximum entropy spectral analysis, 37th meeting of the SEG, 1967.
    .. [2] G. Schwarz, Ann. Statist. 6 (1978) 461, doi:10.1214/aos/1176344136.
    """
    from hdbench.estimation.harmonics import without_lines

    usable = np.isfinite(residual) if valid is None else valid & np.isfinite(residual)
    n_usable = int(usable.sum())
    clean = np.where(usable, residual, 0.0)
    if not (n_usable >= 4 and np.any(clean)):
        raise ValueError(f"a noise model needs 4 samples that are not all zero, found {n_usable}")
    clean = without_lines(clean, usable)
    position = run_positions(usable, starts)
    # one parameter per ten samples at most, so that short records do not fit their own noise
    highest = max(0, min(max_order, n_usable // 10))
    predictors, stds = _burg(clean, position, highest)
    orders = np.arange(len(stds))
    bic = n_usable * np.log(stds**2) + orders * np.log(n_usable)
    best = int(np.argmin(bic))
    return NoiseModel(tuple(predictors[: best + 1]), stds[: best + 1], n_usable)


def _burg(
    series: FloatArray, position: NDArray[np.int64], max_order: int
) -> tuple[list[FloatArray], FloatArray]:
    """Return the predictors of orders 0 ... max_order and their error stds."""
    forward = series.copy()
    backward = series.copy()
    power = float(np.mean(series[position >= 0] ** 2))
    predictors: list[FloatArray] = [np.zeros(0)]
    powers = [power]
    for order in range(1, max_order + 1):
        use = position[order:] >= order
        ahead = forward[order:][use]
        behind = backward[order - 1 : -1][use]
        energy = float(ahead @ ahead + behind @ behind)
        # a run too short, or a residual predicted to rounding, ends the recursion
        if not energy > np.finfo(float).eps * powers[0] * max(1, len(ahead)):
            break
        reflection = 2.0 * float(ahead @ behind) / energy
        last = predictors[-1]
        predictors.append(np.concatenate([last - reflection * last[::-1], [reflection]]))
        powers.append(powers[-1] * (1.0 - reflection**2))
        step_forward = forward[order:] - reflection * backward[order - 1 : -1]
        backward[order:] = backward[order - 1 : -1] - reflection * forward[order:]
        forward[order:] = step_forward
    return predictors, np.sqrt(np.array(powers))


def whiten(
    columns: FloatArray,
    model: NoiseModel,
    valid: NDArray[np.bool_] | None = None,
    *,
    starts: NDArray[np.bool_] | None = None,
) -> FloatArray:
    """Divide out the colour of the noise: the result has unit, white noise.

    Parameters
    ----------
    columns : ndarray, shape (n,) or (n, k)
        Response or design columns, unit of the noise.
    model : NoiseModel
        Noise to be whitened.
    valid : ndarray of bool, shape (n,), optional
        Samples that can be used; all without it. A gap splits the record.
    starts : ndarray of bool, shape (n,), optional
        Where a new stretch begins, see `run_positions`.

    Returns
    -------
    ndarray, shape (n,) or (n, k)
        Whitened columns, dimensionless; 0 where not valid.

    Notes
    -----
    ``x~(k) = (x(k) - sum_i a_i x(k - i)) / std``; the first samples of each run use the
    predictors of lower order, so that no sample is lost and the likelihood is exact for a
    stationary Gaussian noise. Cost O(n k order).
    """
    table = columns[:, None] if columns.ndim == 1 else columns
    usable = np.ones(len(table), dtype=bool) if valid is None else valid
    position = run_positions(usable, starts)
    filled = np.where(usable[:, None], table, 0.0)
    kernel = np.concatenate([[1.0], -model.coefficients])
    white = np.empty_like(filled)
    for column in range(filled.shape[1]):
        white[:, column] = np.convolve(filled[:, column], kernel)[: len(filled)]
    white /= model.innovation_std
    for order in range(model.order):
        at = np.flatnonzero(position == order)
        past = filled[at[:, None] - np.arange(1, order + 1)]
        guess = np.einsum("rjk,j->rk", past, model.predictors[order])
        white[at] = (filled[at] - guess) / model.stds[order]
    white[~usable] = 0.0
    return white[:, 0] if columns.ndim == 1 else white


# largest ratio of singular values of the scaled design that still gives digits to trust
_MAX_CONDITION = 1e8
_ROUNDS = 2


@dataclass(frozen=True, slots=True)
class LinearFit:
    """Coefficients of ``response = design @ coefficients + noise``."""

    # shape (k,): Estimates, unit of the response over that of each column
    coefficients: FloatArray
    # shape (k, k): Their covariance
    covariance: FloatArray
    # effective degrees of freedom of the covariance, at least 1
    dof: float
    # shape (n,): Response minus fit; NaN where not used
    residual: FloatArray
    # shape (n,): Samples that entered
    used: NDArray[np.bool_]
    # noise model of a coloured fit
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
    residual = _residual(design, response, used, coefficients)
    dof = float(used.sum() - design.shape[1])
    variance = float(residual[used] @ residual[used]) / dof
    return LinearFit(coefficients, variance * inverse, dof, residual, used)


def _residual(
    design: FloatArray, response: FloatArray, used: NDArray[np.bool_], coefficients: FloatArray
) -> FloatArray:
    """Return response minus fit, NaN where not used."""
    residual = np.full(len(response), np.nan)
    residual[used] = response[used] - design[used] @ coefficients
    return residual


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
        residual = _residual(design, response, used, coefficients)
    white = table[:, -1] - table[:, :-1] @ coefficients
    free = float(len(white) - design.shape[1])
    variance = float(white @ white) / free
    dof = max(1.0, 2.0 / (2.0 / free + noise.density_variance))
    return LinearFit(coefficients, variance * inverse, dof, residual, used, noise)
