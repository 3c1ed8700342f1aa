"""Reference generator: waves and programs in volts of motor reference."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.profile.schema import ReferenceWave
from hdbench.records.trace import FloatArray


def reference_voltage(wave: ReferenceWave, time_s: FloatArray, duration_s: float) -> FloatArray:
    r"""Return the generator's output at `time_s`.

    Parameters
    ----------
    wave : ReferenceWave
        Wave type, bias and amplitude in V, frequency in Hz, duty, rise and fall as shares.
    time_s : ndarray, shape (n,)
        Time since the start of the generator, s.
    duration_s : float
        Length of the run, s, above 0. The output is zero before 0 and at and after this time.

    Returns
    -------
    ndarray, shape (n,)
        Motor reference, V.

    Raises
    ------
    ValueError
        If `duration_s` is not positive and finite, or a time is not finite.

    Notes
    -----
    With :math:`p` the fraction of the period (0 at the start) the output is
    bias + amplitude times

    * constant: 1;
    * sine: :math:`\sin 2 \pi p`;
    * square: +1 while p < duty, else -1;
    * triangle: 0 rising to 1 at p = 1/4, falling to -1 at p = 3/4, back to 0;
    * trapezoid: a positive, then a negative half period, each of which rises from 0 to 1 over the
      share `rise` of that half, stays for `duty`, falls to 0 over `fall` and rests for the rest;
    * chirp: :math:`\sin 2 \pi (f_0 t + (f_1 - f_0) t^2 / 2 T)`, T the duration: the frequency goes
      linearly from :math:`f_0` to :math:`f_1`.
    """
    if not 0.0 < duration_s < math.inf:
        raise ValueError(f"duration_s {duration_s!r} must be positive and finite, s")
    time = np.asarray(time_s, dtype=np.float64)
    if not bool(np.isfinite(time).all()):
        raise ValueError("time_s must be finite, s")
    running = (time >= 0.0) & (time < duration_s)
    level = _unit_wave(wave, np.where(running, time, 0.0), duration_s)
    return np.where(running, wave.bias_v + wave.amplitude_v * level, 0.0)


def _unit_wave(wave: ReferenceWave, time: FloatArray, duration_s: float) -> FloatArray:
    """Return the wave for bias 0 and amplitude 1."""
    cycles = wave.frequency_hz * time
    phase = cycles - np.floor(cycles)
    match wave.wave:
        case "constant":
            return np.ones_like(time)
        case "sine":
            return np.asarray(np.sin(2.0 * np.pi * phase))
        case "square":
            return np.where(phase < wave.duty, 1.0, -1.0)
        case "triangle":
            return _triangle(phase)
        case "trapezoid":
            return _trapezoid(phase, wave.rise, wave.duty, wave.fall)
        case "chirp":
            slope = (wave.end_frequency_hz - wave.frequency_hz) / (2.0 * duration_s)
            return np.asarray(np.sin(2.0 * np.pi * (cycles + slope * time * time)))


def _triangle(phase: FloatArray) -> FloatArray:
    """Return the triangle that starts at 0 rising; `phase` in [0, 1)."""
    return np.select(
        [phase < 0.25, phase < 0.75], [4.0 * phase, 2.0 - 4.0 * phase], 4.0 * phase - 4.0
    )


def _trapezoid(phase: FloatArray, rise: float, duty: float, fall: float) -> FloatArray:
    """Return the bipolar trapezoid; `phase` in [0, 1), shares of the half wave."""
    negative: NDArray[np.bool_] = phase >= 0.5
    half = 2.0 * phase - np.where(negative, 1.0, 0.0)
    # a share of zero is an edge without width: its branch is never chosen, so 1 only avoids 0/0
    going_up = half / (rise if rise > 0.0 else 1.0)
    going_down = 1.0 - (half - rise - duty) / (fall if fall > 0.0 else 1.0)
    height = np.select(
        [half < rise, half < rise + duty, half < rise + duty + fall],
        [going_up, np.ones_like(half), going_down],
        0.0,
    )
    return np.where(negative, -height, height)


# parts that a node keeps; the longest protocol that hdbench proposes has 61
MAX_PARTS = 128


@dataclass(frozen=True, slots=True)
class ProgramPart:
    r"""One part of a program: a ramp with a sine on it.

    Notes
    -----
    :math:`u(t) = u_0 + (u_1 - u_0) t / T + A \sin 2 \pi (f_0 t + (f_1 - f_0) t^2 / 2T)` with t from
    the start of the part and T its length.
    """

    n_samples: int
    start_v: float
    end_v: float  # of the ramp, at the first sample after the part
    amplitude_v: float = 0.0
    frequency_hz: float = 0.0
    end_frequency_hz: float = 0.0

    @property
    def peak_v(self) -> float:
        """Bound of the part's magnitude, V; NaN where a value is."""
        ends = np.maximum(abs(self.start_v), abs(self.end_v))
        return float(ends) + abs(self.amplitude_v)


@dataclass(frozen=True, slots=True)
class ReferenceProgram:
    """Motor reference of one acquisition as parts."""

    parts: tuple[ProgramPart, ...]

    @property
    def n_samples(self) -> int:
        """Length in samples."""
        return sum(part.n_samples for part in self.parts)

    @property
    def peak_v(self) -> float:
        """Bound of the reference's magnitude, V."""
        return float(np.max([part.peak_v for part in self.parts]))


def program_voltage(program: ReferenceProgram, sample_period_s: float) -> FloatArray:
    """Return the generator's output at every sample of a program."""
    if not 0.0 < sample_period_s < math.inf:
        raise ValueError(f"sample_period_s {sample_period_s!r} must be positive and finite, s")
    pieces = []
    for part in program.parts:
        if part.n_samples < 1 or not math.isfinite(part.peak_v):
            raise ValueError(f"a part needs at least one sample and finite volts, got {part}")
        sample = np.arange(part.n_samples, dtype=np.float64)
        share = sample / part.n_samples
        time = sample * sample_period_s
        swing = 0.5 * (part.end_frequency_hz - part.frequency_hz) * share
        cycles = (part.frequency_hz + swing) * time
        ramp = part.start_v + (part.end_v - part.start_v) * share
        pieces.append(ramp + part.amplitude_v * np.sin(2.0 * np.pi * (cycles - np.floor(cycles))))
    return np.concatenate(pieces)


def reference_values(
    reference: ReferenceWave | ReferenceProgram | None, sample_period_s: float, duration_s: float
) -> FloatArray:
    """Return the reference at every sample of an acquisition, at least one; zeros without one."""
    if isinstance(reference, ReferenceProgram):
        return program_voltage(reference, sample_period_s)
    n_samples = max(1, round(duration_s / sample_period_s))
    if reference is None:
        return np.zeros(n_samples)
    time_s = np.arange(n_samples, dtype=np.float64) * sample_period_s
    # where rounding puts the last sample at the end, the generator still runs
    return reference_voltage(reference, time_s, max(duration_s, n_samples * sample_period_s))
