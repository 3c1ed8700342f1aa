"""Spectra small enough for a picture that keep every peak."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.result import Spectrum
from hdbench.records.trace import FloatArray

__all__ = ["peak_spectrum"]

# cells of a spectrum that a picture can show
_SPECTRUM_POINTS = 2000


def peak_spectrum(
    domain: str, unit: str, grid: FloatArray, before: FloatArray, after: FloatArray
) -> Spectrum:
    """Return a spectrum of at most 2000 cells that keeps every peak."""
    width = max(1, -(-len(grid) // _SPECTRUM_POINTS))
    starts = np.arange(0, len(grid), width)
    top = np.maximum.reduceat(before, starts)
    # a cell is placed at its largest line, so that a peak stands where it was found
    places = [
        int(s + np.argmax(np.maximum(before[s : s + width], after[s : s + width]))) for s in starts
    ]
    return Spectrum(domain, unit, grid[places], top, np.maximum.reduceat(after, starts))
