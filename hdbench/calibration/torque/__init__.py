"""Torque of weights on an arm: model, corrections, uncertainty."""

from __future__ import annotations

from hdbench.calibration.torque.lever import (
    AppliedTorque,
    Conditions,
    air_density,
    applied_torque,
    buoyancy_factors,
)
from hdbench.calibration.torque.sources import torque_sources

__all__ = [
    "AppliedTorque",
    "Conditions",
    "air_density",
    "applied_torque",
    "buoyancy_factors",
    "torque_sources",
]
