"""A filter model as C99 source for a controller: the kernel's own source, numbers, self-test."""

from __future__ import annotations

from hdbench.filter.firmware.export import export_firmware

__all__ = ["export_firmware"]
