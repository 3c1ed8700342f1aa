"""Windowed spectra of a steady stretch, with peaks named by frequency and motor order."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.estimation.harmonics import background
from hdbench.records.trace import FloatArray
from hdbench.results.dynamic import SpectrumLine

# half width of the main lobe of a Hann window, in bins; peaks closer than it are one peak
_LOBE_BINS = 2.0
# side lobes of a Hann window reach 2.7 % of the peak and noise adds to them; a neighbour below
# this share is taken for one
_SIDE_LOBE = 0.06
# width of the running median of the noise, in resolutions: wider than any line, narrow enough to
# follow coloured noise
_MEDIAN_RESOLUTIONS = 25.0
# chance that noise alone shows an unnamed peak anywhere
_FALSE_ALARM = 1e-2


@dataclass(frozen=True, slots=True)
class Spectrum:
    """One-sided amplitude spectrum of an evenly sampled stretch."""

    # shape (m,): Frequencies, Hz, from 0 to half the sampling rate
    frequency_hz: FloatArray
    # shape (m,): Amplitude of a sinusoid at that frequency, unit of the signal
    amplitude: FloatArray
    # shape (m,): One-sided power spectral density, unit of the signal squared per Hz
    power_density: FloatArray
    # one over the length of the stretch, Hz; the grid is finer by zero padding
    resolution_hz: float


def amplitude_spectrum(signal: FloatArray, sample_period_s: float) -> Spectrum:
    """Return the amplitude spectrum under a Hann window, mean removed.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Evenly sampled signal without gaps, n at least 16.
    sample_period_s : float
        Sampling period, s, above 0.

    Returns
    -------
    Spectrum

    Raises
    ------
    ValueError
        If samples are too few or not finite.

    Notes
    -----
    ``amplitude = 2 |sum w x e| / sum w``; ``power = 2 dt |sum w x e|^2 / sum w^2``; zero padded
    to at least four times the length, so that a peak is read to 1 % of its amplitude.
    """
    n = len(signal)
    if not (n >= 16 and np.isfinite(signal).all() and sample_period_s > 0.0):
        raise ValueError(f"a spectrum needs at least 16 finite samples, found {n}")
    window = np.hanning(n)
    size = 1 << (4 * n - 1).bit_length()
    line = np.abs(np.fft.rfft(window * (signal - np.mean(signal)), size))
    return Spectrum(
        frequency_hz=np.asarray(np.fft.rfftfreq(size, sample_period_s), dtype=np.float64),
        amplitude=2.0 * line / window.sum(),
        power_density=2.0 * sample_period_s * line**2 / float(window @ window),
        resolution_hz=1.0 / (n * sample_period_s),
    )


def find_peaks(
    spectrum: Spectrum,
    motor_velocity_rad_s: float,
    named_orders: Mapping[str, float],
) -> tuple[SpectrumLine, ...]:
    """Return the peaks above the noise, strongest first, with those at given orders named.

    Parameters
    ----------
    spectrum : Spectrum
        Spectrum of a stretch at nearly constant velocity.
    motor_velocity_rad_s : float
        Mean motor velocity of the stretch, rad/s, not 0.
    named_orders : mapping of str to float
        Name to motor order; the strongest peak within one resolution of it takes the name.

    Returns
    -------
    tuple of SpectrumLine

    Notes
    -----
    Noise is the running median of the power over ln 2 (exponential distribution); a peak counts
    from ``-ln(0.01 / bins)`` times it, the bins counted without padding: noise alone shows an
    unnamed peak anywhere in 1 %. A named peak needs no threshold beyond being a local maximum: the
    place was known before.
    """
    amplitude, frequency = spectrum.amplitude, spectrum.frequency_hz
    motor_hz = abs(motor_velocity_rad_s) / (2.0 * math.pi)
    lobe = _LOBE_BINS * spectrum.resolution_hz
    inner = np.arange(1, len(amplitude) - 1)
    local = inner[
        (amplitude[inner] >= amplitude[inner - 1])
        & (amplitude[inner] > amplitude[inner + 1])
        & (frequency[inner] > lobe)
    ]
    padding = spectrum.resolution_hz / float(frequency[1])
    level = background(amplitude**2, max(16, round(_MEDIAN_RESOLUTIONS * padding)))
    bins = max(1.0, float(frequency[-1]) / spectrum.resolution_hz)
    strong = local[amplitude[local] ** 2 > -level[local] * math.log(_FALSE_ALARM / bins)]
    names = _names(local, spectrum, motor_hz, named_orders)
    kept: list[int] = sorted(names, key=lambda i: -amplitude[i])
    for i in sorted((int(i) for i in strong), key=lambda i: -amplitude[i]):
        close = [j for j in kept if abs(frequency[i] - frequency[j]) < 3.0 * lobe]
        if all(
            abs(frequency[i] - frequency[j]) >= lobe and amplitude[i] > _SIDE_LOBE * amplitude[j]
            for j in close
        ):
            kept.append(i)
    peaks = [
        SpectrumLine(
            name=names.get(i),
            frequency_hz=float(frequency[i]),
            angular_frequency_rad_s=2.0 * math.pi * float(frequency[i]),
            order=float(frequency[i]) / motor_hz,
            amplitude_nm=float(amplitude[i]),
        )
        for i in kept
    ]
    return tuple(sorted(peaks, key=lambda peak: -peak.amplitude_nm))


def _names(
    local: NDArray[np.intp], spectrum: Spectrum, motor_hz: float, named_orders: Mapping[str, float]
) -> dict[int, str]:
    names: dict[int, str] = {}
    for name, order in named_orders.items():
        near = local[
            np.abs(spectrum.frequency_hz[local] - order * motor_hz) <= spectrum.resolution_hz
        ]
        if len(near):
            names[int(near[np.argmax(spectrum.amplitude[near])])] = name
    return names
