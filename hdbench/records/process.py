"""Whether the process that wrote a run is still the one with its number."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from typing import Any

from hdbench.system.processes import process_exists, process_mark

__all__ = ["still_running"]

# a run appends to its journal several times a second; waiting for a weight takes minutes
_SILENCE_S = 600.0


def still_running(manifest: Mapping[str, Any], journal_age_s: float | None) -> bool:
    """Return whether the process that wrote `manifest` still lives."""
    pid = manifest.get("pid")
    if not (isinstance(pid, int) and 0 < pid < 1 << 31):
        return False
    if manifest.get("host") != socket.gethostname():
        return journal_age_s is not None and journal_age_s < _SILENCE_S
    mark = manifest.get("process_mark")
    if isinstance(mark, str):
        return process_mark(pid) == mark
    return process_exists(pid)
