"""A filter model as C99 source for a controller."""

from __future__ import annotations

from hdbench.filter.firmware.export import export_firmware

__all__ = ["export_firmware"]
