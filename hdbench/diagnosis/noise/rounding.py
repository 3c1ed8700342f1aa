"""What a converter with coarse steps reads on average: an error that follows the signal."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.acquisition.codes import Comb, find_comb
from hdbench.diagnosis.measured.record import Record
from hdbench.records.trace import FloatArray

__all__ = ["Rounding", "coarse_rounding", "mean_rounding", "steps_of"]

# noise ahead of the converter, in steps, over which the best is taken; half a step dithers it away
_DITHERS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5)
# harmonics of the saw tooth: those beyond are below a thirtieth of the first
_HARMONICS = 30
# steps below this many standard deviations of what is left are dithered away by the noise
_COARSE = 2.0


def mean_rounding(
    torque_nm: FloatArray, level_nm: float, step_nm: float, noise_nm: float
) -> FloatArray:
    """Return the mean error of a converter's reading.

    Parameters
    ----------
    torque_nm : ndarray, shape (n,)
        Torque ahead of noise and converter, N m.
    level_nm : float
        Any of its levels, N m.
    step_nm : float
        Distance between neighbouring levels, N m, above 0.
    noise_nm : float
        Standard deviation of the normal noise ahead of the converter, N m, not below 0.

    Returns
    -------
    ndarray, shape (n,)
        N m.

    Notes
    -----
    ``q/pi sum_k (-1)^k / k exp(-2 (pi k s / q)^2) sin(2 pi k (m - m0) / q)`` for steps q, noise s,
    a level m0 and the torque m.

    References
    ----------
    .. [1] B. Widrow, I. Kollar, Quantization Noise, Cambridge University Press 2008.
    """
    turn = 2.0 * np.pi * (torque_nm - level_nm) / step_nm
    error = np.zeros(len(torque_nm))
    for k in range(1, _HARMONICS):
        weight = float(np.exp(-2.0 * (np.pi * k * noise_nm / step_nm) ** 2))
        error += (-1.0) ** k / k * weight * np.sin(k * turn)
    return np.asarray(step_nm / np.pi * error)


@dataclass(frozen=True, slots=True)
class Rounding:
    """Coarse steps of a torque channel.

    Parameters
    ----------
    step_nm : float
        Distance between neighbouring levels, N m.
    level_nm : float
        One of them, N m.
    held_nm : ndarray, shape (n_samples,), or None
        Mean error that a record holds fixed, N m.
    hides_steps : bool
        True once a step of the zero was found that came down to a reading's rounding.
    """

    step_nm: float
    level_nm: float
    held_nm: FloatArray | None = None
    hides_steps: bool = False

    def taken_out(self, record: Record, fitted_nm: FloatArray) -> tuple[Record, Rounding]:
        """Return the record with the mean error of its readings held fixed.

        Parameters
        ----------
        record : Record
            Record; `held_nm` is part of what it holds fixed.
        fitted_nm : ndarray, shape (n_samples,)
            What is fitted beside what is fixed, N m.

        Returns
        -------
        record : Record
        rounding : Rounding
            With the new mean error.
        """
        fixed = record.fixed_nm if self.held_nm is None else record.fixed_nm - self.held_nm
        error = self._error(record, fixed + fitted_nm)
        return replace(record, fixed_nm=fixed + error), replace(self, held_nm=error)

    def _error(self, record: Record, predicted_nm: FloatArray) -> FloatArray:
        """Return the mean error at the noise that explains most; zero where none does, N m."""
        valid = record.valid
        torque, left = predicted_nm[valid], (record.torque_nm - predicted_nm)[valid]
        best, least = np.zeros(len(torque)), float(left @ left)
        for dither in _DITHERS:
            error = mean_rounding(torque, self.level_nm, self.step_nm, dither * self.step_nm)
            rest = left - error
            if float(rest @ rest) < least:
                best, least = error, float(rest @ rest)
        whole = np.zeros(len(valid))
        whole[valid] = best
        return whole


def steps_of(record: Record) -> Comb | None:
    """Return the grid on which the readings of a record's torque lie, coarse or fine.

    Parameters
    ----------
    record : Record
        Record.

    Returns
    -------
    Comb or None
    """
    return find_comb(record.torque_nm[record.valid])


def coarse_rounding(record: Record, fitted_nm: FloatArray, comb: Comb | None) -> Rounding | None:
    """Return the steps of a record's torque where the noise does not dither them away.

    Parameters
    ----------
    record : Record
        Record.
    fitted_nm : ndarray, shape (n_samples,)
        What is fitted beside what is fixed, N m.
    comb : Comb or None
        As `steps_of` gives it.

    Returns
    -------
    Rounding or None
    """
    if comb is None:
        return None
    valid = record.valid
    left = (record.response_nm - fitted_nm)[valid]
    # the median size of normal noise is 0.6745 standard deviations
    scatter = float(np.median(np.abs(left))) / 0.6745
    if not comb.step_nm > _COARSE * scatter:
        return None
    return Rounding(comb.step_nm, float(record.torque_nm[valid][0]))
