"""Free-motion runs to ripple orders, their spectrum and the filter's suppression."""

from __future__ import annotations

from hdbench.ripple.evaluation import Stretch, evaluate_ripple

__all__ = ["Stretch", "evaluate_ripple"]
