"""What a spoilt line still has to deliver, each piece at its time."""

from __future__ import annotations

import contextlib
import heapq
import itertools
import threading
import time
from collections.abc import Callable

from linefaults.faults import Delivery

__all__ = ["Outlet"]


class Outlet:
    """Delivers pieces in the order of their times, from a thread of its own.

    Parameters
    ----------
    write : callable
        Sends bytes.
    end : callable
        Hangs up, in the way that a piece asks for.
    """

    def __init__(self, write: Callable[[bytes], None], end: Callable[[str], None]) -> None:
        self._write = write
        self._end = end
        self._heap: list[tuple[float, int, Delivery]] = []
        self._order = itertools.count()
        self._changed = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def put(self, pieces: list[Delivery]) -> None:
        """Deliver pieces, each after its time."""
        now_s = time.monotonic()
        with self._changed:
            for piece in pieces:
                heapq.heappush(self._heap, (now_s + piece.after_s, next(self._order), piece))
            self._changed.notify()

    def close(self) -> None:
        """Deliver nothing more; what is being written now may still end."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    @property
    def runs(self) -> bool:
        """Whether something may still be written."""
        return self._thread.is_alive()

    def join(self) -> None:
        """Wait until nothing more will be written."""
        self._thread.join()

    def _run(self) -> None:
        # the other side may hang up at any moment
        with contextlib.suppress(OSError):
            while (piece := self._next()) is not None:
                self._deliver(piece)

    def _next(self) -> Delivery | None:
        with self._changed:
            while not self._ended:
                if not self._heap:
                    self._changed.wait()
                    continue
                wait_s = self._heap[0][0] - time.monotonic()
                if wait_s <= 0.0:
                    return heapq.heappop(self._heap)[2]
                self._changed.wait(wait_s)
        return None

    def _deliver(self, piece: Delivery) -> None:
        if piece.per_byte_s:
            for byte in piece.data:
                if self._ends_within(piece.per_byte_s):
                    return
                self._write(bytes((byte,)))
        elif piece.data:
            self._write(piece.data)
        if piece.then:
            self._end(piece.then)

    def _ends_within(self, wait_s: float) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: self._ended, wait_s)
