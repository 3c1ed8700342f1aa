"""Noise whose power rises without end towards 0 Hz: flicker, and the random walk of a zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.noise.whitened import Space
from hdbench.records.trace import FloatArray

__all__ = ["FLICKER", "RANDOM_WALK", "SlowNoise", "SlowSpectrum", "slow_kernel", "slow_spectrum"]

FLICKER = 1.0
RANDOM_WALK = 2.0
# blocks whose sums are transformed: 8 Hz in two minutes, where noise of this kind still shows
_BLOCKS = 2048
# least share of a coefficient that the explained columns leave
_LEAST_LEFT = 0.3
# exponents tried
_EXPONENTS = (0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.4)
# powers tried, at one cycle in twice the record and in units of the white noise
_POWERS = np.geomspace(1e-2, 1e12, 141)


@dataclass(frozen=True, slots=True)
class SlowNoise:
    """Spectrum ``1 + power k^-exponent``, k the number of half cycles in the record.

    Parameters
    ----------
    power : float
        Above 0, relative to the rest of the noise.
    exponent : float
        1 for flicker, 2 for a random walk.
    gain_nats : float
        Log likelihood gained by it.
    """

    power: float
    exponent: float
    gain_nats: float

    def to_dict(self) -> dict[str, float]:
        """Return power, exponent and gain as a JSON-able object."""
        return {"power": self.power, "exponent": self.exponent, "gain_nats": self.gain_nats}


@dataclass(frozen=True, slots=True)
class SlowSpectrum:
    """Cosine coefficients of a whitened residual.

    Parameters
    ----------
    squares : ndarray, shape (m,)
        Squared coefficients 1 ... m over half cycles in the record, each of mean one for white
        noise.
    left : ndarray, shape (m,)
        Share of each that the explained columns leave.
    """

    squares: FloatArray
    left: FloatArray

    def fit(self, exponent: float) -> SlowNoise:
        """Return the most likely slow noise of an exponent.

        Parameters
        ----------
        exponent : float
            Exponent of the spectrum.

        Returns
        -------
        SlowNoise
            By Whittle's likelihood over a grid of powers 26 % apart; its gain is over noise that is
            white at a level of its own.
        """
        index = np.arange(1.0, len(self.squares) + 1.0)
        usable = self.left > _LEAST_LEFT
        weight = self.left[usable]
        square = self.squares[usable] / weight
        rise = np.multiply.outer(_POWERS, index[usable] ** -exponent)
        total = float(weight.sum())
        levels = (square / (1.0 + rise)) @ weight / total
        flat = float(square @ weight) / total
        gains = 0.5 * (total * np.log(flat / levels) - np.log1p(rise) @ weight)
        best = int(np.argmax(gains))
        return SlowNoise(float(_POWERS[best]), exponent, float(gains[best]))

    def exponent(self) -> float:
        """Return the most likely exponent between 0.6 and 2.4."""
        return max(_EXPONENTS, key=lambda e: self.fit(e).gain_nats)


def _blocked(columns: FloatArray) -> FloatArray:
    """Return sums over blocks, of unit variance for white noise."""
    count = min(_BLOCKS, len(columns))
    edges = (np.arange(count) * len(columns)) // count
    return np.asarray(np.add.reduceat(columns, edges, axis=0) / np.sqrt(len(columns) / count))


def slow_spectrum(space: Space) -> SlowSpectrum:
    """Return the slow spectrum of the residual of a space.

    Parameters
    ----------
    space : Space
        Whitened residual.

    Returns
    -------
    SlowSpectrum

    Notes
    -----
    The cosines over half cycles are the principal components of a random walk with a free zero.
    """
    from scipy.fft import dct

    squares = dct(_blocked(space.residual), norm="ortho")[1:] ** 2
    explained = dct(_blocked(space.basis), norm="ortho", axis=0)[1:]
    return SlowSpectrum(squares, np.maximum(1.0 - np.sum(explained**2, axis=1), 0.0))


def slow_kernel(slow: SlowNoise, n_samples: int) -> FloatArray:
    """Return the causal filter of minimum phase that whitens slow noise.

    Parameters
    ----------
    slow : SlowNoise
        Noise.
    n_samples : int
        Samples of the record.

    Returns
    -------
    ndarray, shape (n_samples,)
        Its response; its spectrum is one over the root of ``1 + power k^-exponent``.

    References
    ----------
    .. [1] A. V. Oppenheim, R. W. Schafer, Discrete-time signal processing, section 13 (minimum
       phase from the real cepstrum).
    """
    from scipy.fft import irfft, next_fast_len, rfft

    size = int(next_fast_len(4 * n_samples, real=True))
    size += size % 2
    index = np.arange(size // 2 + 1) * (2.0 * n_samples / size)
    # below a quarter cycle in the record nothing is seen
    spectrum = 1.0 + slow.power * np.maximum(index, 0.5) ** -slow.exponent
    cepstrum = irfft(-0.5 * np.log(spectrum), size)
    cepstrum[1 : size // 2] *= 2.0
    cepstrum[size // 2 + 1 :] = 0.0
    return np.asarray(irfft(np.exp(rfft(cepstrum, size)), size)[:n_samples])
