"""Is a straight line enough? Lack of fit against the scatter of repetitions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.estimation.regression import LinearFit, ordinary_fit
from hdbench.records.trace import FloatArray

__all__ = ["LackOfFit", "SeriesLackOfFit", "lack_of_fit", "series_lack_of_fit"]


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """A polynomial and the test whether it is enough.

    Parameters
    ----------
    fit : LinearFit
        Coefficients from the constant up.
    residual_std : float
        Standard deviation of the residuals with their dof.
    pure_error, lack : float
        Sums of squares within and between distinct abscissae.
    pure_dof, lack_dof : int
        Their degrees of freedom.
    ratio, probability : float or None
        F and its probability; None without pure error.
    """

    fit: LinearFit
    residual_std: float
    pure_error: float
    lack: float
    pure_dof: int
    lack_dof: int
    ratio: float | None
    probability: float | None


@dataclass(frozen=True, slots=True)
class SeriesLackOfFit:
    """What all series have in common about the straight lines through their zeros.

    Parameters
    ----------
    curve_v : ndarray, shape (m,)
        Mean residual of each step, V.
    lack, pure_error : float
        Sums of squares, V^2.
    lack_dof, pure_dof : int
        Their degrees of freedom.
    ratio, probability : float or None
        F and its probability; None for one series or no scatter.
    relative : float
        Largest of the curve over the largest deflection.
    pooled_ratio : float or None
        F of one line for all series, which scatter of their gains hides the curve from.
    """

    curve_v: FloatArray
    lack: float
    pure_error: float
    lack_dof: int
    pure_dof: int
    ratio: float | None
    probability: float | None
    relative: float
    pooled_ratio: float | None

    def to_dict(self) -> dict[str, object]:
        """Return the test as results store it."""
        return {
            "curve_v": [float(c) for c in self.curve_v],
            "relative": self.relative,
            "f_ratio": self.ratio,
            "probability": self.probability,
            "dof": [self.lack_dof, self.pure_dof],
            "pooled_f_ratio": self.pooled_ratio,
        }


def lack_of_fit(x: FloatArray, y: FloatArray, degree: int = 1) -> LackOfFit:
    """Fit a polynomial and test it against repetitions at equal abscissae.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Abscissae, some of them repeated, and values.
    degree : int
        Degree of the polynomial, at least 1.

    Returns
    -------
    LackOfFit

    Raises
    ------
    ValueError
        If there are too few values for the polynomial.

    Notes
    -----
    ``F = [(SSE - SSPE) / (m - k)] / [SSPE / (n - m)]`` for m distinct abscissae and k
    coefficients. Valid for true repetitions only.

    References
    ----------
    .. [1] NIST/SEMATECH e-Handbook of Statistical Methods, section 4.4.4.6.
    """
    scale = float(np.max(np.abs(x))) or 1.0
    powers = scale ** np.arange(degree + 1)
    design = np.column_stack([(x / scale) ** power for power in range(degree + 1)])
    scaled = ordinary_fit(design, y)
    fit = LinearFit(
        scaled.coefficients / powers,
        scaled.covariance / np.outer(powers, powers),
        scaled.dof,
        scaled.residual,
        scaled.used,
    )
    levels, places = np.unique(x, return_inverse=True)
    count = np.bincount(places)
    within = y - (np.bincount(places, weights=y) / count)[places]
    pure, total = float(within @ within), float(fit.residual @ fit.residual)
    pure_dof, lack_dof = len(x) - len(levels), len(levels) - degree - 1
    ratio, probability = _test(total - pure, lack_dof, pure, pure_dof)
    std = float(np.sqrt(total / (len(x) - degree - 1)))
    return LackOfFit(fit, std, pure, total - pure, pure_dof, lack_dof, ratio, probability)


def series_lack_of_fit(torque_nm: FloatArray, deflection_v: FloatArray) -> SeriesLackOfFit | None:
    """Test straightness with one slope for each series.

    Parameters
    ----------
    torque_nm : ndarray, shape (m,)
        Steps, N m, above 0.
    deflection_v : ndarray, shape (j, m)
        Deflections of each series, V; series that lack a step are left out.

    Returns
    -------
    SeriesLackOfFit or None
        None for fewer than two steps or no complete series.

    Notes
    -----
    ``r_jk = X_jk - S_j T_k`` with the slope of each series through zero, ``c_k`` their mean;
    ``SS_lof = J sum c_k^2`` with m - 1 dof, ``SS_pe = sum (r_jk - c_k)^2`` with (J - 1)(m - 1).
    The gain may differ from series to series without hiding a curve that all share.
    """
    rows = deflection_v[np.isfinite(deflection_v).all(axis=1)]
    n_series, steps = rows.shape
    if n_series < 1 or steps < 2:
        return None
    square = float(torque_nm @ torque_nm)
    slopes = rows @ torque_nm / square
    left = rows - np.outer(slopes, torque_nm)
    curve = left.mean(axis=0)
    lack = n_series * float(curve @ curve)
    pure = float(((left - curve) ** 2).sum())
    dof = (steps - 1, (n_series - 1) * (steps - 1))
    ratio, probability = _test(lack, dof[0], pure, dof[1])
    top = float(np.max(np.abs(rows.mean(axis=0))))
    return SeriesLackOfFit(
        curve,
        lack,
        pure,
        dof[0],
        dof[1],
        ratio,
        probability,
        float(np.max(np.abs(curve))) / top if top > 0.0 else 0.0,
        _pooled(torque_nm, rows),
    )


def _pooled(torque_nm: FloatArray, rows: FloatArray) -> float | None:
    """Return F of one line through zero for all series."""
    n_series, steps = rows.shape
    mean = rows.mean(axis=0)
    slope = float(mean @ torque_nm) / float(torque_nm @ torque_nm)
    off = mean - slope * torque_nm
    lack, pure = n_series * float(off @ off), float(((rows - mean) ** 2).sum())
    return _test(lack, steps - 1, pure, (n_series - 1) * steps)[0]


def _test(
    lack: float, lack_dof: int, pure: float, pure_dof: int
) -> tuple[float | None, float | None]:
    if not (pure > 0.0 and pure_dof > 0 and lack_dof > 0):
        return None, None
    from scipy.special import fdtrc

    ratio = max(0.0, lack) / lack_dof / (pure / pure_dof)
    return ratio, float(fdtrc(lack_dof, pure_dof, ratio))
