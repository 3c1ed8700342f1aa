"""Spectra small enough for a picture that keep every peak."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.diagnosis.answer.result import Spectrum
from hdbench.diagnosis.detect.scan import ScanResult

__all__ = ["peak_spectrum"]

# cells of a spectrum that a picture can show
_SPECTRUM_POINTS = 2000


def peak_spectrum(
    domain: str, unit: str, first: Mapping[str, ScanResult], last: Mapping[str, ScanResult]
) -> Spectrum:
    """Return a spectrum of at most 2000 cells that keeps every peak.

    Parameters
    ----------
    domain, unit : str
        Axis and its unit.
    first, last : mapping of str to ScanResult
        Scans of the first and of the last residual, by domain; their grids may differ where the
        motion was aligned anew in between.

    Returns
    -------
    Spectrum
        Largest amplitude of each cell, N m, at the place where it stands.
    """
    grid, after = last[domain].grid, last[domain].amplitude
    before = np.zeros(len(grid))
    if domain in first:
        before = np.interp(grid, first[domain].grid, first[domain].amplitude)
    width = max(1, -(-len(grid) // _SPECTRUM_POINTS))
    starts = np.arange(0, len(grid), width)
    top = np.maximum.reduceat(before, starts)
    # a cell is placed at its largest line, so that a peak stands where it was found
    higher = np.maximum(before, after)
    places = [int(s + np.argmax(higher[s : s + width])) for s in starts]
    return Spectrum(domain, unit, grid[places], top, np.maximum.reduceat(after, starts))
