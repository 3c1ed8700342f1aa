"""The torque in the channel where that is read at another time than the motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.measured.record import Record
from hdbench.model.delay import delayed
from hdbench.records.trace import FloatArray

__all__ = ["signal_in_channel"]

# delays tried, s: no further than those of the catalogue's time skew, and near enough that a
# parabola through three of them finds the smallest sum of squares between
_DELAYS_S = np.array([-5.0, -4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0]) * 1e-3
# slopes of the baseline must take the sum of squares down to this before any delay is tried, and a
# delay must do so itself: a smaller one is its first order, which any signal shows
_PLAINLY = 0.7
# samples whose residual stands for the record
_THIN = 20_000


def signal_in_channel(record: Record, fitted_nm: FloatArray) -> FloatArray:
    """Return the torque that a time skew delays, N m, without what is fixed.

    Parameters
    ----------
    record : Record
        Record.
    fitted_nm : ndarray, shape (n_samples,)
        Baseline and causes as fitted without a delay, N m.

    Returns
    -------
    ndarray, shape (n_samples,)
        `fitted_nm`; where baseline and fixed torque, all delayed alike, plainly fit better, the
        baseline of that fit: a ripple that is read late has no amplitude at the phase at which it
        was to be fitted.
    """
    columns = np.column_stack([record.columns, record.nuisance, record.fixed_nm])
    columns[~record.valid] = np.nan
    rows = np.flatnonzero(record.valid)[:: max(1, int(record.valid.sum()) // _THIN)]
    if len(rows) <= 2 * columns.shape[1]:
        return fitted_nm
    slopes = np.nan_to_num(np.gradient(columns, axis=0))
    limit = _PLAINLY * _left(columns[rows], record.torque_nm[rows])[0]
    both = np.hstack([columns[:, :-1], slopes])
    if not _left(np.column_stack([both, columns[:, -1]])[rows], record.torque_nm[rows])[0] < limit:
        return fitted_nm
    tried = [_delayed_fit(record, columns, rows, float(delay)) for delay in _DELAYS_S]
    best = int(np.argmin([left for left, _ in tried]))
    if not tried[best][0] < limit:
        return fitted_nm
    if 0 < best < len(tried) - 1:
        tried.append(_delayed_fit(record, columns, rows, _between(tried, best)))
    linear = min(tried, key=lambda one: one[0])[1]
    return np.nan_to_num(columns[:, :-1]) @ linear


def _left(design: FloatArray, torque: FloatArray) -> tuple[float, FloatArray]:
    """Return what least squares leave of a torque whose last column is fixed, and coefficients."""
    free, response = design[:, :-1], torque - design[:, -1]
    linear = np.asarray(np.linalg.lstsq(free, response, rcond=None)[0], dtype=np.float64)
    left = response - free @ linear
    return float(left @ left), linear


def _delayed_fit(
    record: Record, columns: FloatArray, rows: NDArray[np.intp], delay_s: float
) -> tuple[float, FloatArray]:
    """Return what is left with all columns delayed, and their coefficients."""
    time = record.motion.time_s
    moved = np.column_stack([delayed(time, column, delay_s)[rows] for column in columns.T])
    return _left(moved, record.torque_nm[rows])


def _between(tried: list[tuple[float, FloatArray]], best: int) -> float:
    """Return the delay at the vertex of the parabola through the best one and its neighbours."""
    before, here, after = (tried[best + k][0] for k in (-1, 0, 1))
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(_DELAYS_S[best] + shift * (_DELAYS_S[1] - _DELAYS_S[0]))
