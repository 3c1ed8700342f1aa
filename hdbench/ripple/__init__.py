"""Free-motion runs to ripple orders, their spectrum and the filter's suppression."""

from __future__ import annotations

from hdbench.ripple.evaluation import evaluate_ripple
from hdbench.ripple.record import Stretch
from hdbench.ripple.result import RippleOrder, RippleResult, SteadySpectrum, VelocityRange

__all__ = [
    "RippleOrder",
    "RippleResult",
    "SteadySpectrum",
    "Stretch",
    "VelocityRange",
    "evaluate_ripple",
]
