"""Least squares with coloured noise, effective degrees of freedom, spectra in Hz and orders."""

from __future__ import annotations

from hdbench.estimation.harmonics import (
    Harmonic,
    combine,
    harmonic_at,
    harmonic_columns,
    scaled,
)
from hdbench.estimation.regression import (
    LinearFit,
    NoiseModel,
    coloured_fit,
    fit_noise,
    ordinary_fit,
    run_positions,
    whiten,
)
from hdbench.estimation.search import (
    Line,
    LineFit,
    fit_with_lines,
    strongest_line,
)
from hdbench.estimation.spectrum import Spectrum, SpectrumPeak, amplitude_spectrum, find_peaks
from hdbench.estimation.stretches import data_flags, stretch_starts

__all__ = [
    "Harmonic",
    "Line",
    "LineFit",
    "LinearFit",
    "NoiseModel",
    "Spectrum",
    "SpectrumPeak",
    "amplitude_spectrum",
    "coloured_fit",
    "combine",
    "data_flags",
    "find_peaks",
    "fit_noise",
    "fit_with_lines",
    "harmonic_at",
    "harmonic_columns",
    "ordinary_fit",
    "run_positions",
    "scaled",
    "stretch_starts",
    "strongest_line",
    "whiten",
]
