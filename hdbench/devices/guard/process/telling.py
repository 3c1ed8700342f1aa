"""What a person reads of the guard: on stderr, and in the run folder."""

from __future__ import annotations

import contextlib
import json
import os
import threading
import time
from typing import Any

from hdbench.system.files import sync_file

# what a line takes where somebody reads it, s
_SAY_S = 0.05
# the thread of the last line
_last: list[threading.Thread] = []


def say(text: str) -> None:
    """Say it on stderr, if that is still there and takes it: what nobody reads is dropped."""
    if _last and _last[-1].is_alive():
        return
    line = f"hdbench guard: {text}\n".encode(errors="replace")

    def write() -> None:
        with contextlib.suppress(OSError):
            os.write(2, line)

    # a pipe that is full holds up this thread alone
    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    writer.join(_SAY_S)
    _last[:] = [writer]


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
                sync_file(handle)
            finally:
                os.close(handle)
