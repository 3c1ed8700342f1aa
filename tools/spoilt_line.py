"""A served device and a line that spoils its replies: what the campaigns of faults share."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from hdbench.devices.emulator.faultlines import faulty_serial, faulty_tcp
from hdbench.devices.emulator.faults import Mangler

__all__ = ["behind", "in_thread"]


class Server(Protocol):
    """Serves a device until it is closed."""

    def close(self) -> None:
        """End every connection."""
        ...


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
        yield f"tcp://{near}:{near_port}"
