"""Where a line comes nearest to an effect: spectra of the effect over angle and over time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.fft import next_fast_len, rfft

from hdbench.diagnosis.planning.sketch import Sketch
from hdbench.records.trace import FloatArray

__all__ = ["Bands", "LineSpectra", "holds"]

Bands = tuple[tuple[float, float], ...]

# points of a spectrum per resolution cell: a line between two of them keeps 81 % of its power
_PER_CELL = 2.0
# strongest places that are handed out; neighbours nearer than two cells are sidelobes
_PEAKS = 3
_APART_CELLS = 2.0
# columns in one transform: as many single-precision values as one instruction works on
_SIDE_BY_SIDE = 4


def holds(bands: Bands, place: float) -> bool:
    """Return whether a place lies in one of the bands.

    Parameters
    ----------
    bands : tuple of (float, float)
        Bands.
    place : float
        Place, same unit.

    Returns
    -------
    bool
    """
    return any(low <= place <= high for low, high in bands)


@dataclass(slots=True)
class LineSpectra:
    """Spectra of effects over motor turns and time, computed once for each.

    Parameters
    ----------
    sketch : Sketch
        Sketch of the motion.
    tops : mapping of str to float
        Highest ``order`` and ``frequency_hz`` that any cause asks for.
    """

    sketch: Sketch
    tops: dict[str, float]
    _kept: dict[tuple[str, str], tuple[FloatArray, FloatArray]] = field(
        default_factory=dict, init=False
    )

    def cell(self, key: str) -> float:
        """Return the width of a resolution cell: 1 / turns, or 1 / duration."""
        return 1.0 / max(float(np.ptp(self._position(key))), np.finfo(float).tiny)

    def peaks(
        self, name: str, left: FloatArray, key: str, bands: Bands, harmonics: Iterable[int]
    ) -> list[float]:
        """Return the strongest places of an effect as those of a line or of its harmonics.

        Parameters
        ----------
        name : str
            Name of the effect: its spectrum is kept.
        left : ndarray, shape (m, k)
            Its whitened columns on the rows of the sketch.
        key : str
            ``order`` or ``frequency_hz``.
        bands : tuple of (float, float)
            Where the line may lie.
        harmonics : iterable of int
            Multiples of its place at which the line has power too.

        Returns
        -------
        list of float
        """
        axis, power = self._spectrum(name, left, key)
        reach = int(np.ceil(_APART_CELLS * _PER_CELL))
        places = []
        for harmonic in harmonics:
            inside = np.zeros(len(axis), dtype=bool)
            for low, high in bands:
                inside |= (axis >= harmonic * low) & (axis <= harmonic * high)
            rest = np.where(inside, power, 0.0)
            for _ in range(_PEAKS):
                at = int(np.argmax(rest))
                if not rest[at] > 0.0:
                    break
                places.append(float(axis[at]) / harmonic)
                rest[max(0, at - reach) : at + reach + 1] = 0.0
        return places

    def _position(self, key: str) -> FloatArray:
        """Return what the places count on: turns or seconds."""
        few = self.sketch.few
        return few.angle_rad / (2.0 * np.pi) if key == "order" else few.time_s

    def _spectrum(self, name: str, left: FloatArray, key: str) -> tuple[FloatArray, FloatArray]:
        if (name, key) not in self._kept:
            self._kept[name, key] = self._transform(left, key)
        return self._kept[name, key]

    def _transform(self, left: FloatArray, key: str) -> tuple[FloatArray, FloatArray]:
        """Return the axis and the power of all columns together."""
        position = self._position(key) - float(self._position(key).min())
        length = _PER_CELL * max(float(position.max()), np.finfo(float).tiny)
        n = next_fast_len(int(np.ceil(max(16.0, 2.0 * self.tops[key] * length))), real=True)
        bins = np.minimum((position * (n / length)).astype(np.intp), n - 1)
        power = np.zeros(n // 2 + 1, dtype=np.float32)
        # the inverse probability of a row: sums over rows are then those over all samples
        weighted = left * self.sketch.weights[:, None]
        # a few columns in one transform: as many as one instruction works on
        for first in range(0, left.shape[1], _SIDE_BY_SIDE):
            part = weighted[:, first : first + _SIDE_BY_SIDE].T
            folded = np.zeros((len(part), n), dtype=np.float32)
            for row, column in zip(folded, part, strict=True):
                row[:] = np.bincount(bins, column, n)
            line = rfft(folded, axis=1, overwrite_x=True)
            power += np.sum(line.real**2 + line.imag**2, axis=0)
        return np.arange(len(power)) / length, power.astype(np.float64)
