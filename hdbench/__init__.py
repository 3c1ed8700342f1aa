"""hdbench: the bench of a harmonic drive with a built-in torque sensor."""

from __future__ import annotations

__all__ = ["__version__"]

__version__ = "0.2.0"
