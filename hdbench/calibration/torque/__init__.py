"""Torque of weights on an arm: model, corrections, uncertainty."""

from __future__ import annotations

from hdbench.calibration.torque.air import air_density, buoyancy_factors
from hdbench.calibration.torque.lever import AppliedTorque, Conditions, Correction, applied_torque
from hdbench.calibration.torque.sources import mass_limits, torque_sources

__all__ = [
    "AppliedTorque",
    "Conditions",
    "Correction",
    "air_density",
    "applied_torque",
    "buoyancy_factors",
    "mass_limits",
    "torque_sources",
]
