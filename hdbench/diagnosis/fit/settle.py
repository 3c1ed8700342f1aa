"""Causes and noise fitted in turn; what the noise model must not swallow."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.detect.scanplan import LineScan
from hdbench.diagnosis.fit.jointfit import JointFit, fit_jointly
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.noise.notch import without_lines
from hdbench.diagnosis.noise.restored import restored
from hdbench.diagnosis.noise.slownoise import SlowNoise, SlowSpectrum, slow_kernel, slow_spectrum
from hdbench.diagnosis.noise.whitened import Whitener, make_space, make_whitener
from hdbench.estimation import NoiseModel, fit_noise
from hdbench.records.trace import FloatArray

__all__ = [
    "Hidden",
    "InSlow",
    "Noise",
    "nats",
    "plain_spectrum",
    "settle",
    "without_coarse",
]

# normal noise passes this many standard deviations once in a billion samples
_FAR = 6.1
# rounds of slow noise and colour in turn
_ROUNDS = 3
# where more than a twentieth of the samples are larger, the noise is not normal
_CALM = 0.95


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise model and its whitener.

    Parameters
    ----------
    model : NoiseModel
        Autoregression; its innovation is in N m.
    whitener : Whitener
        Its operator on the record.
    slow : SlowNoise or None
        Power that rises towards 0 Hz, where that was accepted.
    """

    model: NoiseModel
    whitener: Whitener
    slow: SlowNoise | None = None

    @property
    def ar_kernel(self) -> FloatArray:
        """Kernel that whitens all but the slow noise."""
        return np.concatenate([[1.0], -self.model.coefficients])


@dataclass(frozen=True, slots=True)
class InSlow:
    """The log likelihood of the terms of a fit where slow noise takes a share.

    Parameters
    ----------
    fit : JointFit
        Fit that the terms are from.
    noise : Noise
        Noise that the fit in turn begins with.
    exponent : float
        Exponent of the slow noise.
    nats : float
        Log likelihood.
    """

    fit: JointFit
    noise: Noise
    exponent: float
    nats: float


@dataclass(frozen=True, slots=True)
class Hidden:
    """What a noise model must not see: coarse columns, and lines.

    Parameters
    ----------
    coarse : ndarray of float32, shape (n_samples, k)
        Orthonormal columns, as `coarse_basis` makes them.
    scans : tuple of LineScan
        Scans; those over motor order and frequency find the lines.
    """

    coarse: NDArray[np.float32]
    scans: tuple[LineScan, ...]


def _noise_of(record: Record, fit: JointFit, hidden: Hidden, exponent: float) -> Noise:
    left = without_coarse(record, fit, hidden)
    if not exponent > 0.0:
        steady = _steady(left, record.valid)
        model = fit_noise(left, steady, starts=record.starts, keep_lines=False)
        model = restored(model, hidden.coarse.shape[1] / int(record.valid.sum()))
        return Noise(model, make_whitener(model, record.valid, record.starts))
    slow = plain_spectrum(record, fit, left).fit(exponent)
    noise = _slow_first(record, left, slow)
    for _ in range(_ROUNDS):
        if not noise.model.order:
            break
        # the colour that is left has a slope of its own, which the power was fitted with
        colour = make_whitener(noise.model, record.valid, record.starts)
        slow = slow_spectrum(make_space(colour, fit.parts, record.response_nm)).fit(exponent)
        if slow.power == (noise.slow or slow).power:
            break
        noise = _slow_first(record, left, slow)
    return noise


def _slow_first(record: Record, left: FloatArray, slow: SlowNoise) -> Noise:
    """Return the noise of a slow part: that first, then what colour is left."""
    response = slow_kernel(slow, len(left))
    rough = Whitener(response, 1.0, record.valid, record.valid)
    model = fit_noise(rough.apply(left), record.valid, starts=record.starts, keep_lines=False)
    whitener = make_whitener(model, record.valid, record.starts)
    kernel = np.asarray(np.convolve(response, whitener.kernel)[: len(left)], dtype=np.float64)
    return Noise(model, replace(whitener, kernel=kernel), slow)


def _steady(left: FloatArray, valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the valid samples where a residual is no larger than noise ever is.

    What an effect leaves for a moment, as where a step is no step but a short slope, is no noise:
    its spectrum would colour that of the whole record.
    """
    size = np.abs(left)
    # the median size of normal noise is 0.6745 standard deviations
    calm = valid & (size <= _FAR * float(np.median(size[valid])) / 0.6745)
    return calm if calm.sum() > _CALM * valid.sum() else valid


def without_coarse(record: Record, fit: JointFit, hidden: Hidden) -> FloatArray:
    """Return a residual without what a noise model must not see, N m.

    Parameters
    ----------
    record : Record
        Record.
    fit : JointFit
        Fit that the residual belongs to.
    hidden : Hidden
        What the noise model must not see.

    Returns
    -------
    ndarray, shape (n_samples,)
    """
    left = np.where(record.valid, record.response_nm - fit.fitted_nm, 0.0)
    left = left - hidden.coarse @ (hidden.coarse.T @ left.astype(np.float32))
    return without_lines(left, record.valid, hidden.scans)


def plain_spectrum(record: Record, fit: JointFit, left: FloatArray) -> SlowSpectrum:
    """Return the slow spectrum of a residual that is not whitened.

    Parameters
    ----------
    record : Record
        Record.
    fit : JointFit
        Fit.
    left : ndarray, shape (n_samples,)
        As `without_coarse` gives it.

    Returns
    -------
    SlowSpectrum
        In units of the residual: an autoregression would follow the rise towards 0 Hz part of the
        way.
    """
    model = fit_noise(left, record.valid, starts=record.starts, max_order=0, keep_lines=False)
    whitener = make_whitener(model, record.valid, record.starts)
    return slow_spectrum(make_space(whitener, fit.parts, record.response_nm))


def settle(
    record: Record,
    terms: tuple[Term, ...],
    noise: Noise | None,
    hidden: Hidden,
    exponent: float = 0.0,
) -> tuple[JointFit, Noise]:
    """Fit terms and noise in turn.

    Parameters
    ----------
    record : Record
        Record.
    terms : tuple of Term
        Causes.
    noise : Noise or None
        Noise to start from; white without it.
    hidden : Hidden
        What the noise model must not see.
    exponent : float
        Exponent of the slow noise; 0 where there is none.

    Returns
    -------
    fit : JointFit
    noise : Noise
    """
    if noise is None:
        white = _white(record)
        fit = fit_jointly(record, terms, white.whitener, refine=False)
        noise = _noise_of(record, fit, hidden, exponent)
    return _in_turn(record, terms, noise, hidden, exponent)


def _white(record: Record) -> Noise:
    """Return white noise of unit variance."""
    model = NoiseModel((np.zeros(0),), np.ones(1), int(record.valid.sum()))
    return Noise(model, make_whitener(model, record.valid, record.starts))


def _in_turn(
    record: Record, terms: tuple[Term, ...], noise: Noise, hidden: Hidden, exponent: float
) -> tuple[JointFit, Noise]:
    """Return the fit in a noise, the noise that it leaves, and the fit in that."""
    fit = fit_jointly(record, terms, noise.whitener)
    noise = _noise_of(record, fit, hidden, exponent)
    return fit_jointly(record, fit.terms, noise.whitener, refine=False), noise


def nats(fit: JointFit, noise: Noise) -> float:
    """Return the log likelihood of a fit in its noise, but for a constant.

    A whitener is a triangular matrix: its determinant is a power of the kernel's first value.

    Parameters
    ----------
    fit : JointFit
        Fit.
    noise : Noise
        Noise.

    Returns
    -------
    float
        Less what the orders of the noise pay.
    """
    whitener = noise.whitener
    variance = fit.chi2 * whitener.std**2 / int(whitener.used.sum())
    count = float(whitener.valid.sum())
    likelihood = count * (float(np.log(whitener.kernel[0])) - 0.5 * float(np.log(variance)))
    return likelihood - 0.5 * noise.model.order * float(np.log(count))
