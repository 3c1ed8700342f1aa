"""How long an emulator runs, and what it writes down: the same for every device."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import IO

from hdbench.errors import StorageError

__all__ = ["ending", "open_record", "until_motor_stands"]

_POLL_S = 0.01


def open_record(path: Path | None, stack: ExitStack) -> Callable[[Mapping[str, object]], None]:
    """Return what writes one JSON line per event."""
    if path is None:
        return lambda _: None
    try:
        file: IO[str] = stack.enter_context(path.open("w", encoding="utf-8", buffering=1))
    except OSError as error:
        raise StorageError(
            f"cannot be written ({error.strerror})", where=str(path), fix="choose another file"
        ) from error

    def record(event: Mapping[str, object]) -> None:
        file.write(json.dumps(event, allow_nan=False) + "\n")

    return record


def ending(lifeline: int | None) -> asyncio.Event:
    """Return what is set by SIGTERM, by Ctrl-C where there is no lifeline, or by its end."""
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()

    def end(*_: object) -> None:
        # perhaps the loop has ended meanwhile
        with suppress(RuntimeError):
            loop.call_soon_threadsafe(ended.set)

    signal.signal(signal.SIGTERM, end)
    if lifeline is None:
        signal.signal(signal.SIGINT, end)
    else:
        threading.Thread(target=_until_end, args=(lifeline, end), daemon=True).start()
    return ended


def _until_end(descriptor: int, end: Callable[[], None]) -> None:
    """Wait for the end of a file in a thread: no loop can wait for a pipe on every system."""
    with suppress(OSError):
        while os.read(descriptor, 1):
            pass
    end()


async def until_motor_stands(moving: Callable[[], bool], longest_s: float) -> None:
    """Give the watchdog its time: an orphaned device still has to stop its motor."""
    until_s = time.monotonic() + longest_s
    while moving() and time.monotonic() < until_s:
        await asyncio.sleep(_POLL_S)
