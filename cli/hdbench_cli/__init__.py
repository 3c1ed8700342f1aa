"""Commands of hdbench."""

from __future__ import annotations

import sys
from types import TracebackType

__all__: list[str] = []

_before = sys.excepthook


def _quiet_interrupt(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """End without a traceback where Ctrl-C comes before a command has begun to listen for it."""
    if issubclass(kind, KeyboardInterrupt):
        sys.stderr.write("stopped\n")
        return
    _before(kind, error, trace)


sys.excepthook = _quiet_interrupt
