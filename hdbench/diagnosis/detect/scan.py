"""Continuous scans of the residual over motor order, output order and frequency."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.detect.scanplan import LineScan
from hdbench.diagnosis.noise.whitened import Space
from hdbench.records.trace import FloatArray

__all__ = ["ScanResult", "null_scans", "scan_line", "upcrossing_rate"]

# share of a column that must be left after the baseline was projected out
_MIN_SHARE = 0.05
# level of the upcrossing count: low enough for hundreds of crossings in one draw
_LEVEL = 6.0
# grid points of an axis so short that what is explained takes part of every line
_FEW = 2000
# points at which the response of a whitener is taken along a scan
_COARSE_POINTS = 2048


@dataclass(frozen=True, slots=True)
class ScanResult:
    """Statistic of a scan.

    Parameters
    ----------
    grid : ndarray, shape (n_grid,)
        Orders, or Hz.
    statistic : ndarray, shape (n_grid,)
        chi^2 with two degrees of freedom without a line; 0 where it cannot be formed.
    amplitude : ndarray, shape (n_grid,)
        Amplitude of the best line, N m.
    sigma : ndarray, shape (n_grid,)
        Standard deviation of each quadrature, N m; infinite where it cannot be formed.
    usable : ndarray of bool, shape (n_grid,)
        Where it could be formed.
    """

    grid: FloatArray
    statistic: FloatArray
    amplitude: FloatArray
    sigma: FloatArray
    usable: NDArray[np.bool_]


def _norms(space: Space, scan: LineScan) -> tuple[FloatArray, NDArray[np.complex64]]:
    """Return sum |F|^2 and sum F^2 of the whitened line exp(-i phase) at each grid point.

    The whitener acts on a line of slowly changing rate as its frequency response there; rates
    are gathered in classes, which moves the sums by less than the classes are wide.
    """
    grid, whitener = scan.single.grid, space.whitener
    share = space.n_used / max(1, int(whitener.valid.sum()))
    if len(whitener.kernel) == 1:
        gain = whitener.std**-2
        doubled = np.zeros(len(grid), dtype=np.complex64)
        for _, part in scan.doubled:
            doubled += np.float32(gain * share) * part
        return np.full(len(grid), gain * space.n_used), doubled
    magnitude = np.abs(scan.rate[whitener.used])
    counts, edges = np.histogram(magnitude, bins=32, range=(0.0, float(magnitude.max()) + 1e-300))
    sums, _ = np.histogram(magnitude, bins=edges, weights=magnitude)
    kept = counts > 0
    rates = sums[kept] / counts[kept]
    # the total changes over the response of the whitener, not from cell to cell
    coarse = np.linspace(grid[0], grid[-1], min(len(grid), _COARSE_POINTS))
    size = np.abs(whitener.power_gain(np.multiply.outer(rates, coarse).ravel())) ** 2
    total = np.interp(grid, coarse, counts[kept] @ size.reshape(len(rates), -1))
    doubled = np.zeros(len(grid), dtype=np.complex64)
    for mean, part in scan.doubled:
        response = whitener.power_gain(-mean * coarse) ** 2
        weight = np.interp(grid, coarse, response.real) + 1j * np.interp(
            grid, coarse, response.imag
        )
        doubled += (share * weight).astype(np.complex64) * part
    return total, doubled


@dataclass(frozen=True, slots=True)
class _Gram:
    """Gram matrix of cosine and sine at every grid point, and where it can be inverted."""

    cc: FloatArray
    ss: FloatArray
    cs: FloatArray
    usable: NDArray[np.bool_]

    def statistic(self, sums: NDArray[np.complex64]) -> FloatArray:
        """Return chi^2 with two degrees of freedom at every grid point."""
        c, s = sums.real, -sums.imag
        value = self.ss * c**2 - 2.0 * self.cs * c * s + self.cc * s**2
        return np.where(self.usable, value / self.determinant, 0.0)

    @property
    def determinant(self) -> FloatArray:
        """Determinant, 1 where not usable."""
        return np.where(self.usable, self.cc * self.ss - self.cs**2, 1.0)


def _gram(space: Space, scan: LineScan) -> _Gram:
    total, doubled = _norms(space, scan)
    cc, ss = 0.5 * (total + doubled.real), 0.5 * (total - doubled.real)
    cs = np.asarray(-0.5 * doubled.imag, dtype=np.float64)
    # on a long axis the explained columns take next to nothing from any line that is not their own,
    # and their own are gone from the residual
    few = len(scan.single.grid) <= _FEW
    for column in space.pull_basis.T if few else ():
        part = scan.single(column)
        cc = cc - part.real**2
        ss = ss - part.imag**2
        cs = cs + part.real * part.imag
    half = np.hypot(0.5 * (cc - ss), cs)
    return _Gram(cc, ss, cs, 0.5 * (cc + ss) - half > _MIN_SHARE * 0.5 * total)


def scan_line(space: Space, scan: LineScan) -> ScanResult:
    """Return the statistic of a line at every grid point.

    Parameters
    ----------
    space : Space
        Whitened residual.
    scan : LineScan
        Scan.

    Returns
    -------
    ScanResult

    Notes
    -----
    ``T = v' (X' M X)^-1 v``, v the sums of the pulled residual with cosine and sine, and
    ``X' M X`` the whitened columns' Gram matrix less what the explained columns take from it; that
    is left out on axes of more than 2000 points, where T is too small within a resolution cell of
    an explained line.
    """
    gram = _gram(space, scan)
    sums = scan.single(space.pull)
    c, s = sums.real, -sums.imag
    determinant = gram.determinant
    amplitude = np.hypot(gram.ss * c - gram.cs * s, gram.cc * s - gram.cs * c) / determinant
    mean = 0.5 * (gram.cc + gram.ss)
    sigma = np.where(gram.usable, np.sqrt(np.maximum(mean, 0.0) / determinant), np.inf)
    return ScanResult(
        scan.single.grid,
        gram.statistic(sums),
        np.where(gram.usable, amplitude, 0.0),
        sigma,
        gram.usable,
    )


def null_scans(space: Space, scan: LineScan, pulls: FloatArray) -> Iterator[FloatArray]:
    """Return the statistic of white noise at every grid point, draw by draw.

    Parameters
    ----------
    space : Space
        Whitened residual.
    scan : LineScan
        Scan.
    pulls : ndarray, shape (n, draws)
        As `Space.null_pulls`.

    Yields
    ------
    ndarray, shape (n_grid,)
    """
    gram = _gram(space, scan)
    for pull in pulls.T:
        yield gram.statistic(scan.single(pull))


def upcrossing_rate(draws: Iterable[FloatArray], dof: int = 2) -> float:
    """Return W of ``P(max T > c) <= P_k(c) + W (c/2)^((k-1)/2) exp(-c/2)`` from draws of a scan.

    Parameters
    ----------
    draws : iterable of ndarray, shape (n_grid,)
        Statistic of white noise, one array for each draw; they need not fit into memory together.
    dof : int
        Degrees of freedom k of the statistic.

    Returns
    -------
    float
        Mean number of upcrossings at a low level, carried to any level by the law of a chi^2
        field with k degrees of freedom.

    References
    ----------
    .. [1] E. Gross, O. Vitells, Eur. Phys. J. C 70 (2010) 525, arXiv:1005.1891.
    """
    level = _LEVEL + 2.0 * (dof - 2)
    counts = [int(((draw[:-1] <= level) & (draw[1:] > level)).sum()) for draw in draws]
    # an empty count is known to three at 95 %
    mean = max(sum(counts), 3.0) / max(1, len(counts))
    return float(mean / ((0.5 * level) ** (0.5 * (dof - 1)) * np.exp(-0.5 * level)))
