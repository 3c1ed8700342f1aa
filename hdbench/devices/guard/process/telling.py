"""What a person reads of the guard: on stderr, and in the run folder."""

from __future__ import annotations

import contextlib
import json
import os
import select
import time
from typing import Any


def say(text: str) -> None:
    """Say it on stderr, if that is still there and takes it: nobody need read it."""
    line = f"hdbench guard: {text}\n".encode(errors="replace")
    with contextlib.suppress(OSError, ValueError):
        # a pipe or terminal that is ready takes so much without a wait
        if select.select([], [2], [], 0.0)[1]:
            os.write(2, line[: select.PIPE_BUF])


def let_go_of_pipes() -> None:
    """Keep nobody waiting who reads what the session said; a person at a terminal is told on."""
    with contextlib.suppress(OSError):
        if not os.isatty(2):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 2)
            os.close(nowhere)


def write_down(log: str | None, why: str, problem: str, took_s: float) -> None:
    """Add one line to the log, where there is one."""
    event: dict[str, Any] = {
        "event": "guard",
        "why": why,
        "confirmed": not problem,
        "problem": problem or None,
        "took_s": round(took_s, 4),
        "utc_s": round(time.time(), 3),
    }
    if log:
        # a full disk does not keep a motor from being stopped
        with contextlib.suppress(OSError):
            handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            try:
                os.write(handle, json.dumps(event).encode() + b"\n")
                os.fsync(handle)
            finally:
                os.close(handle)
