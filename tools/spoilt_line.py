"""A served device and a line that spoils its replies: what the campaigns of faults share."""

from __future__ import annotations

import asyncio
import os
import threading
import time
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from linefaults.faults import Mangler
from linefaults.lines import faulty_serial, faulty_tcp

__all__ = ["Deadlines", "behind", "in_thread"]

# what deadlines are to be kept within
OVER = 1.1


class Server(Protocol):
    """Serves a device until it is closed."""

    def close(self) -> None:
        """End every connection."""
        ...


class Deadlines:
    """Counts how calls keep their deadline.

    Parameters
    ----------
    deadline_s : float
        Of one call, s.

    Attributes
    ----------
    over, held_up : int
        Calls of more than 1.1 deadlines, and those among them that are within it without the time
        for which threads of this process - device, line and host - were ready to run and had no
        processor.
    worst : float
        Longest call over its deadline.
    """

    def __init__(self, deadline_s: float) -> None:
        self.over = self.held_up = 0
        self.worst = 0.0
        self._deadline_s = deadline_s

    @contextmanager
    def call(self, allowed: float = 1.0) -> Iterator[None]:
        """Time one call of `allowed` deadlines."""
        waited_s, start_s = _ready_s(), time.monotonic()
        try:
            yield
        finally:
            took_s = time.monotonic() - start_s
            limit_s = allowed * self._deadline_s
            self.worst = max(self.worst, took_s / limit_s)
            if took_s > OVER * limit_s:
                self.over += 1
                self.held_up += took_s - (_ready_s() - waited_s) <= OVER * limit_s


def _ready_s() -> float:
    """Return how long threads of this process have waited for a processor so far, s."""
    total_ns = 0
    for thread in os.listdir("/proc/self/task"):
        try:
            with open(f"/proc/self/task/{thread}/schedstat", encoding="ascii") as file:
                total_ns += int(file.read().split()[1])
        except OSError:
            continue
    return 1e-9 * total_ns


@contextmanager
def in_thread(server: Server, opening: Coroutine[Any, Any, Any]) -> Iterator[Any]:
    """Run a server in a loop of its own thread; yields what its opening returned."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()

    async def shut() -> None:
        server.close()
        # one turn of the loop closes what is open
        await asyncio.sleep(0.01)

    try:
        yield asyncio.run_coroutine_threadsafe(opening, loop).result(5)
    finally:
        asyncio.run_coroutine_threadsafe(shut(), loop).result(5)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(5)
        loop.close()


@contextmanager
def behind(address: str, mangler: Mangler) -> Iterator[str]:
    """Put faults before a device; yields the address for the host."""
    scheme, _, rest = address.partition("://")
    if scheme == "rtu":
        with faulty_serial(rest, mangler) as path:
            yield f"rtu://{path}"
        return
    host, _, port = rest.rpartition(":")
    with faulty_tcp(host, int(port), mangler) as (near, near_port):
        yield f"{scheme}://{near}:{near_port}"
