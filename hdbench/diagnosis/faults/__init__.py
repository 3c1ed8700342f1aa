"""Faults of the acquisition: hypotheses with evidence from the torque or a second channel."""

from __future__ import annotations

from hdbench.diagnosis.faults.converter import coarse_steps
from hdbench.diagnosis.faults.fault import Fault, Inspected
from hdbench.diagnosis.faults.inspection import inspect_channels
from hdbench.diagnosis.faults.residual import ResidualFaults, faults_of_residual
from hdbench.diagnosis.faults.units import check_channels

__all__ = [
    "Fault",
    "Inspected",
    "ResidualFaults",
    "check_channels",
    "coarse_steps",
    "faults_of_residual",
    "inspect_channels",
]
