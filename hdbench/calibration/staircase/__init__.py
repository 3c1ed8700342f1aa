"""Raw readings under changing weights: plateaus found, glitches left out, loads made of them."""

from __future__ import annotations

from hdbench.calibration.staircase.importing import (
    StaircasePlan,
    StaircaseReport,
    import_staircase,
)
from hdbench.calibration.staircase.plateaus import Plateau, Staircase, find_plateaus

__all__ = [
    "Plateau",
    "Staircase",
    "StaircasePlan",
    "StaircaseReport",
    "find_plateaus",
    "import_staircase",
]
