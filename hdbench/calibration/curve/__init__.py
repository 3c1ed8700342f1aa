"""The shape of the curve: hysteresis, lack of fit, line through its ends."""

from __future__ import annotations

from hdbench.calibration.curve.hysteresis import Loop, loading_loop
from hdbench.calibration.curve.lackoffit import (
    LackOfFit,
    SeriesLackOfFit,
    lack_of_fit,
    series_lack_of_fit,
)
from hdbench.calibration.curve.terminal import TerminalLine, terminal_line

__all__ = [
    "LackOfFit",
    "Loop",
    "SeriesLackOfFit",
    "TerminalLine",
    "lack_of_fit",
    "loading_loop",
    "series_lack_of_fit",
    "terminal_line",
]
