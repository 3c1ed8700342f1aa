"""Memory: what large arrays leave is kept for the next ones, where the C library can do that."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

# options of glibc's `mallopt`: from which size an array is mapped on its own, and how much free
# memory is kept; bytes
_MAP_FROM, _KEEP = -3, -1
_LARGE, _ALL = 1 << 30, (1 << 31) - 1
# what glibc comes to by itself at most
_USUAL_MAP_FROM, _USUAL_KEEP = 32 << 20, 64 << 20


@contextmanager
def memory_kept() -> Iterator[None]:
    """Keep the memory of freed arrays for new ones while it lasts, then give it back.

    Else every array of some megabytes is made of new pages, which the system fills with zeros: a
    copy takes many times as long. Without glibc nothing changes.
    """
    try:
        library = ctypes.CDLL(None)
        option, trim = library.mallopt, library.malloc_trim
    except (AttributeError, OSError, TypeError):
        yield
        return
    option(_MAP_FROM, _LARGE)
    option(_KEEP, _ALL)
    try:
        yield
    finally:
        option(_MAP_FROM, _USUAL_MAP_FROM)
        option(_KEEP, _USUAL_KEEP)
        trim(0)
