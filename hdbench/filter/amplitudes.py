"""The amplitudes that a running filter believes in at this moment."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.filter.layout import HEADER, INVERSE, STEP
from hdbench.filter.model import FilterModel, OscillatorBlock
from hdbench.records.trace import FloatArray

__all__ = ["BlockAmplitude", "block_amplitudes"]


@dataclass(frozen=True, slots=True)
class BlockAmplitude:
    """Amplitude of one oscillator.

    Parameters
    ----------
    block : OscillatorBlock
        Which one.
    amplitude_nm : float
        Length of its two states, N m.
    std_nm : float
        Standard deviation of the amplitude by the filter's own covariance, N m: right as far as
        its noise is, so tight for a tuned model and wide for the report's.
    """

    block: OscillatorBlock
    amplitude_nm: float
    std_nm: float


def block_amplitudes(model: FilterModel, state: FloatArray) -> tuple[BlockAmplitude, ...]:
    """Return the amplitude of every oscillator of a filter.

    Notes
    -----
    With states a, b of a block and P their covariance: amplitude A = sqrt(a^2 + b^2), variance
    (a^2 P_aa + 2 a b P_ab + b^2 P_bb) / A^2 to first order; (P_aa + P_bb) / 2 at A = 0. Neither
    depends on the phase in which the states are kept.
    """
    size = 2 * (len(model.blocks) + len(model.slow))
    predicted, gain, triangle = np.split(state[HEADER + size :], (size, 2 * size))
    # the state stands before the last sample's measurement: done here
    states = (predicted + state[STEP] * gain).tolist()
    rows, columns = np.tril_indices(size)
    triangle = triangle[: rows.size] - state[INVERSE] * (gain[rows] * gain[columns])
    return tuple(
        _amplitude(block, states[2 * at : 2 * at + 2], _corner(triangle.tolist(), 2 * at))
        for at, block in enumerate(model.blocks)
    )


def _corner(triangle: list[float], first: int) -> tuple[float, float, float]:
    """Return P_aa, P_ab, P_bb of the states `first` and `first` + 1."""
    below = (first + 1) * (first + 2) // 2
    return (
        triangle[first * (first + 1) // 2 + first],
        triangle[below + first],
        triangle[below + first + 1],
    )


def _amplitude(
    block: OscillatorBlock, states: list[float], corner: tuple[float, float, float]
) -> BlockAmplitude:
    a, b = states
    aa, ab, bb = corner
    size = math.hypot(a, b)
    variance = (a * a * aa + 2.0 * a * b * ab + b * b * bb) / size**2 if size else (aa + bb) / 2.0
    return BlockAmplitude(block, size, math.sqrt(max(0.0, variance)))
