"""Two devices that act as one: inputs from the one, outputs from the other."""

from __future__ import annotations

from hdbench.devices.composite.driver import CompositeDaq

__all__ = ["CompositeDaq"]
