"""Whether the process that wrote a run is still the one with its number."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any

__all__ = ["process_mark", "still_running"]

# a run appends to its journal several times a second; waiting for a weight takes minutes
_SILENCE_S = 600.0


def process_mark(pid: int) -> str | None:
    """Return what tells a process from a later one with the same number.

    Parameters
    ----------
    pid : int
        Process number.

    Returns
    -------
    str or None
        Boot and start tick; None where the system does not tell.
    """
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        # fields after the command in parentheses; the start tick is field 22 of all
        return f"{boot}:{stat.rpartition(')')[2].split()[19]}"
    except (OSError, IndexError, UnicodeDecodeError):
        return None


def _exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OSError):
        return True
    return True


def still_running(manifest: Mapping[str, Any], journal_age_s: float | None) -> bool:
    """Return whether the process that wrote `manifest` still lives.

    Parameters
    ----------
    manifest : mapping
        Content of ``run.json``: ``pid``, ``process_mark``, ``host``.
    journal_age_s : float or None
        Time since the journal was last written, s; None without a journal. A run on another
        host counts as running while this is short: only there can its process be seen.

    Returns
    -------
    bool
    """
    pid = manifest.get("pid")
    if not (isinstance(pid, int) and 0 < pid < 1 << 31):
        return False
    if manifest.get("host") != socket.gethostname():
        return journal_age_s is not None and journal_age_s < _SILENCE_S
    mark = manifest.get("process_mark")
    if isinstance(mark, str):
        return process_mark(pid) == mark
    return _exists(pid)
