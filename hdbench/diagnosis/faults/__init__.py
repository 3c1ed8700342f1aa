"""Faults of the acquisition: hypotheses with evidence from the torque or a second channel."""

from __future__ import annotations

from hdbench.diagnosis.faults.converter import Steps, coarse_steps
from hdbench.diagnosis.faults.fault import Fault
from hdbench.diagnosis.faults.inspection import Inspected, inspect_channels
from hdbench.diagnosis.faults.residual import ResidualFaults, SpeedNoise, faults_of_residual
from hdbench.diagnosis.faults.units import Channels, check_channels

__all__ = [
    "Channels",
    "Fault",
    "Inspected",
    "ResidualFaults",
    "SpeedNoise",
    "Steps",
    "check_channels",
    "coarse_steps",
    "faults_of_residual",
    "inspect_channels",
]
