"""Converter: anti-alias filter, range, resolution, encoder counts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

# Slowest integration of the motion; the node's converter runs at this rate or above.
INTEGRATION_RATE_HZ = 10_000.0

# Fewest steps per sample: with less the filter would have no stop band to shape.
MIN_STEPS = 4

# The filter reaches this many samples to either side. A Kaiser window then gives 71 dB over the
# transition from 0.36 to 0.64 of the sampling rate: (A - 7.95) / 2.285 = length * 0.28 * 2 pi / m.
HALF_LENGTH_SAMPLES = 8

# Kaiser's beta for 70 dB: 0.1102 (A - 8.7).
KAISER_BETA = 6.755

CODE_SPAN = 32768


@dataclass(frozen=True, slots=True)
class AnalogueSamples:
    """Samples as they stand before a converter, each of shape (n,)."""

    torque_v: FloatArray
    tacho_v: FloatArray
    current_v: FloatArray
    reference_v: FloatArray
    angle_rad: FloatArray


@dataclass(frozen=True, slots=True)
class RawSamples:
    """Samples as the node's registers hold them, each of shape (n,)."""

    torque_code: NDArray[np.int16]
    tacho_code: NDArray[np.int16]
    current_code: NDArray[np.int16]
    reference_code: NDArray[np.int16]
    encoder_count: NDArray[np.int64]

    @property
    def codes(self) -> NDArray[np.int16]:
        """Codes of the four channels, a row a sample."""
        codes = (self.torque_code, self.tacho_code, self.current_code, self.reference_code)
        return np.stack(codes, axis=1)


def steps_per_sample(sample_period_s: float) -> int:
    """Return how many integration steps lie in one sampling period."""
    # the small difference keeps a product such as 7.000000000000001 from becoming 8 steps
    return max(MIN_STEPS, math.ceil(sample_period_s * INTEGRATION_RATE_HZ - 1e-9))


@dataclass(frozen=True, slots=True)
class Decimator:
    """Linear-phase anti-alias filter and decimation by a whole number.

    Windowed sinc with cut-off at half the sampling rate, Kaiser window [1]_. Sampled at the
    filter's centre there is no lag between the channels and the encoder, which is latched there.
    Below 0.36 of the sampling rate flat within 0.1 %, above 0.64 at least 60 dB down.

    References
    ----------
    .. [1] J. F. Kaiser, "Nonrecursive digital filter design using the I0-sinh window function",
       Proc. IEEE Int. Symp. Circuits and Systems, 1974, pp. 20-23.
    """

    taps: FloatArray

    @classmethod
    def design(cls, n_steps: int) -> Decimator:
        """Return the filter for `n_steps` steps per sample."""
        half = HALF_LENGTH_SAMPLES * n_steps
        offset = np.arange(-half, half)
        response = np.zeros(2 * half)
        response[1:] = np.sinc(offset[1:] / n_steps) * np.kaiser(2 * half - 1, KAISER_BETA)
        return cls((response / response.sum()).reshape(-1, n_steps))

    def apply(self, channels: FloatArray) -> FloatArray:
        """Return filtered samples."""
        partial = channels @ self.taps.T
        n_out = channels.shape[1] - len(self.taps) + 1
        filtered = np.zeros((channels.shape[0], n_out))
        for row in range(len(self.taps)):
            filtered += partial[:, row : row + n_out, row]
        return filtered


def to_code(volt: FloatArray, range_v: float, resolution_bits: int) -> NDArray[np.int16]:
    """Return converter codes of `volt`."""
    step = 1 << (16 - resolution_bits)
    code = np.rint(volt * (CODE_SPAN / (range_v * step))) * step
    clipped: NDArray[np.int16] = np.clip(code, -CODE_SPAN, CODE_SPAN - step).astype(np.int16)
    return clipped


def to_count(angle_rad: FloatArray, counts_per_turn: int) -> NDArray[np.int64]:
    """Return encoder counts of `angle_rad`."""
    turns = angle_rad * (counts_per_turn / (2.0 * math.pi))
    return np.floor(turns + 0.5).astype(np.int64)
