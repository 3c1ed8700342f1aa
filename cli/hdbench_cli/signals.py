"""End by a signal, wherever it finds the program."""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

# a moment later the program is somewhere else
_AGAIN_S = 0.01


def end_by_signals() -> None:
    """End on SIGTERM and SIGHUP with 128 and their number, and never lose one or a Ctrl-C."""
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), _end)
    sys.unraisablehook = _send_again


def _end(signum: int, _frame: FrameType | None) -> NoReturn:
    raise SystemExit(128 + signum)


def _send_again(lost: UnraisableHookArgs) -> None:
    """Send a signal once more that came where nothing can be raised: while objects are cleared."""
    error = lost.exc_value
    signum = getattr(error, "signum", None)
    if isinstance(error, KeyboardInterrupt):
        signum = signal.SIGINT
    elif isinstance(error, SystemExit) and isinstance(error.code, int):
        signum = error.code - 128
    if not isinstance(signum, int) or not signum > 0:
        sys.__unraisablehook__(lost)
        return
    from threading import Thread

    Thread(target=_when_back, args=(signum,), daemon=True).start()


def _when_back(signum: int) -> None:
    """Send a signal once the main thread has left `_send_again`, which would lose it, too."""
    import time
    from threading import main_thread

    from hdbench.system.processes import signal_self

    is_there = True
    while is_there:
        time.sleep(_AGAIN_S)
        frame = sys._current_frames().get(main_thread().ident or 0)  # noqa: SLF001 - no other way
        while frame is not None and frame.f_code is not _send_again.__code__:
            frame = frame.f_back
        is_there = frame is not None
    signal_self(signum)
