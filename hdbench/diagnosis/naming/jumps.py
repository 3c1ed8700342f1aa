"""What is left where the acceleration jumps: samples that the search leaves out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from hdbench.diagnosis.fit.terms import term_columns
from hdbench.diagnosis.measured.record import Record, with_simulated
from hdbench.diagnosis.naming.left import Left
from hdbench.diagnosis.search import Found
from hdbench.model.localfit import fit_derivative
from hdbench.model.motion import ACCELERATION_WINDOW_S
from hdbench.records.trace import FloatArray

__all__ = ["beside_causes", "rate_times_speed"]

# the largest of a million normal samples lies near 5 standard deviations; what is smaller than this
# share of the largest is no jump
_NOISE_SIGMA = 5.0
_SMALL = 0.02
# fewer jumps than this tell no law
_LEAST_JUMPS = 6
# share of a column that must be left beside what the baseline may be off by
_LEAST_LEFT = 0.1
# the form of a cause is known to a tenth of its amplitude
_FORM_SHARE = 0.1


def beside_causes(found: Found, full: Record) -> tuple[FloatArray, FloatArray] | None:
    """Return what is left of a record, and what the causes make of it, where it was left out too.

    Parameters
    ----------
    found : Found
        Result of the search on the record without some samples.
    full : Record
        The same record with them.

    Returns
    -------
    left, causes : ndarray, shape (n,)
        N m, zero where `full` is not valid; None where its baseline is another.
    """
    fit = found.fit
    if full.base.shape[1] != len(fit.base):
        return None
    causes = np.zeros(len(full.valid))
    whole = [term.cause.whole_signal for term in fit.terms]
    for acts_on_all in (False, True):
        signal = np.where(full.valid, full.base @ fit.base + causes, np.nan)
        seen = with_simulated(full, signal)
        for term, linear, last in zip(fit.terms, fit.linear, whole, strict=True):
            if last == acts_on_all:
                causes = causes + term_columns(term, seen) @ linear
    left = np.where(full.valid, full.response_nm - full.base @ fit.base - causes, 0.0)
    return left, np.where(full.valid, causes, 0.0)


def rate_times_speed(found: Found, full: Record) -> Left | None:
    r"""Return a torque that follows the rate of the torque times the speed.

    Parameters
    ----------
    found : Found
        Result of the search on the record without the jumps.
    full : Record
        The same record with them.

    Returns
    -------
    Left or None
        Its place is the speed where it is largest, rad/s; None where the record holds too few
        jumps, or no product of its own.

    Notes
    -----
    Such a torque is there only where the acceleration jumps. The expected torque is off there too,
    by the difference of a jump and its smoothed course, which is odd about the jump; the smoothed
    rate is even, so that its product with the residual is free of that. An error of inertia or of
    time, an offset and the smoothing error itself are projected out of the column :math:`c`. For
    noise of the spectrum S the numerator :math:`c' e` is normal with the variance
    :math:`\int S |C|^2`; the form of accepted causes adds what a tenth of their change within
    each jump can make.
    """
    both = beside_causes(found, full)
    smoothing = _smoothing(full)
    rows = np.flatnonzero(_jumps(full, smoothing) & full.valid)
    if both is None or not len(rows):
        return None
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    if len(runs) < _LEAST_JUMPS:
        return None
    left, causes = both
    column = _column(full, smoothing, rows)
    if column is None:
        return None
    variance = _noise_variance(found, column)
    for run in runs:
        off = _FORM_SHARE * float(np.ptp(causes[run])) * float(np.abs(column[run]).sum())
        variance += off**2
    numerator, energy = float(column @ left), float(column @ column)
    chance = float(erfc(abs(numerator) / np.sqrt(2.0 * variance)))
    torque = column * (numerator / energy)
    speed = full.motion.velocity_rad_s[rows]
    size = np.abs(torque[rows])
    near = speed[size >= 0.5 * float(size.max())]
    return Left(
        "velocity",
        "rad/s",
        float(speed[int(np.argmax(size))]),
        (float(near.min()), float(near.max())),
        float(size.max()),
        chance,
        float(torque @ torque) / len(torque),
    )


def _smoothing(full: Record) -> FloatArray:
    """Return what a window twice as wide takes off the acceleration, rad/s^2."""
    motion = full.motion
    from_angle = motion.acceleration_source == "angle"
    wide = fit_derivative(
        motion.time_s,
        motion.angle_rad if from_angle else motion.velocity_rad_s,
        derivative=2 if from_angle else 1,
        degree=4 if from_angle else 3,
        window_s=2.0 * ACCELERATION_WINDOW_S,
    ).derivative
    return np.nan_to_num(motion.acceleration_rad_s2 - wide)


def _jumps(full: Record, smoothing: FloatArray) -> NDArray[np.bool_]:
    """Return samples within a window of those where two windows see another acceleration."""
    from scipy.ndimage import maximum_filter1d

    size = np.abs(np.where(full.valid, smoothing, 0.0))
    noise = float(np.nan_to_num(full.motion.acceleration_noise_rad_s2))
    far = size > max(_NOISE_SIGMA * noise, _SMALL * float(size.max()))
    width = 1 + 2 * round(ACCELERATION_WINDOW_S / full.period_s)
    return np.asarray(maximum_filter1d(far.astype(np.uint8), width) > 0)


def _column(full: Record, smoothing: FloatArray, rows: NDArray[np.int64]) -> FloatArray | None:
    """Return rate of the expected torque times speed on some rows beside all that may be off."""
    motion = full.motion
    expected = np.where(full.valid, full.fixed_nm, 0.0)
    rate = np.gradient(expected) / full.period_s
    acceleration = np.nan_to_num(motion.acceleration_rad_s2)
    beside = np.column_stack([np.ones(len(rate)), acceleration, rate, smoothing])[rows]
    product = (rate * motion.velocity_rad_s)[rows]
    if not (np.isfinite(product).all() and np.isfinite(beside).all()):
        return None
    beside = beside / np.maximum(np.sqrt(np.mean(beside**2, axis=0)), np.finfo(float).tiny)
    rest = product - beside @ np.linalg.lstsq(beside, product, rcond=None)[0]
    if not float(rest @ rest) > _LEAST_LEFT * float(product @ product):
        return None
    column = np.zeros(len(rate))
    column[rows] = rest
    return column


def _noise_variance(found: Found, column: FloatArray) -> float:
    """Return the variance of the product of a column with the noise."""
    whitener = found.space.whitener
    count = len(column) + len(whitener.kernel)
    gain = np.fft.rfft(whitener.kernel, count)
    power = np.abs(np.fft.rfft(column, count) / gain) ** 2
    return float(whitener.std**2 * (2.0 * power.sum() - power[0]) / count)
