"""The reference generator's program: parts that follow each other without a pause."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.records.trace import FloatArray

__all__ = ["MAX_PARTS", "ProgramPart", "ReferenceProgram", "program_voltage"]

# parts that a node keeps; the longest protocol that hdbench proposes has 61
MAX_PARTS = 128


@dataclass(frozen=True, slots=True)
class ProgramPart:
    r"""One part of a program: a ramp with a sine on it.

    Parameters
    ----------
    n_samples : int
        Length in samples, at least 1.
    start_v, end_v : float
        The ramp's value at the first sample of the part and of what follows it, V.
    amplitude_v : float
        Amplitude of the sine, V.
    frequency_hz, end_frequency_hz : float
        Its frequency at the start and at the end of the part, Hz, at least 0; linear between.

    Notes
    -----
    :math:`u(t) = u_0 + (u_1 - u_0) t / T + A \sin 2 \pi (f_0 t + (f_1 - f_0) t^2 / 2T)` with t from
    the start of the part and T its length.
    """

    n_samples: int
    start_v: float
    end_v: float
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
    """Motor reference of one acquisition as parts.

    Parameters
    ----------
    parts : tuple of ProgramPart
        At least one, at most `MAX_PARTS`.
    """

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
