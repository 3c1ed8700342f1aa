"""Loaded by every worker of a local cluster: Ctrl-C is for the client, which then stops them."""

from __future__ import annotations

import os
import signal
from typing import Any

__all__ = ["dask_setup"]


def dask_setup(_worker: Any) -> None:
    """Leave Ctrl-C of the terminal to the client, and compute on one core."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
