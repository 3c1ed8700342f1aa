"""The emulator's end of the control channel: see `hdbench.devices.simulation`."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any, Protocol

from hdbench.errors import UsageError

_POLL_S = 0.01

# what each value may be; written so that NaN fails
_DOMAINS: dict[str, dict[str, Callable[[Any], bool]]] = {
    "fixture": {
        "locked": lambda value: value in (True, False),
        "position_rad": lambda value: -1e3 <= value <= 1e3,
        "mass_kg": lambda value: 0.0 <= value <= 1e3,
        "direction": lambda value: value in (-1, 1),
    },
    "handling": {
        "swing_rad": lambda value: 0.0 <= value <= 0.5,
        "release_s": lambda value: 0.0 <= value <= 1e4,
        "shunt_ohm": lambda value: 0.0 <= value <= 1e9,
    },
}


class _Bench(Protocol):
    """What has lock, arm and weights."""

    def set_fixture(
        self, *, locked: bool, position_rad: float, mass_kg: float, direction: int
    ) -> None: ...

    def set_handling(self, *, swing_rad: float, release_s: float, shunt_ohm: float) -> None: ...


class Channel:
    """Listens on a free loopback port for a simulated operator.

    Parameters
    ----------
    bench : object
        The simulated bench.
    busy : callable, optional
        Whether nobody can reach into the bench now.
    """

    def __init__(self, bench: _Bench, *, busy: Callable[[], bool] = lambda: False) -> None:
        self._bench = bench
        self._busy = busy
        self._server: asyncio.Server | None = None
        self._connected = 0

    async def open(self) -> str:
        """Listen, and return the address."""
        self._server = await asyncio.start_server(self._talk, "127.0.0.1", 0)
        host, port = self._server.sockets[0].getsockname()[:2]
        return f"tcp://{host}:{port}"

    async def left(self) -> None:
        """Wait until nobody is connected: a guard stays until it has seen the motor stand."""
        while self._connected:
            await asyncio.sleep(_POLL_S)

    def close(self) -> None:
        """Listen no more."""
        if self._server is not None:
            self._server.close()

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._connected += 1
        try:
            while line := await reader.readline():
                refused = _carry_out(line, self._bench, self._busy)
                answer = {"refused": refused} if refused else {"ok": True}
                writer.write(json.dumps(answer).encode() + b"\n")
                await writer.drain()
        except (OSError, ValueError):
            # it hung up, or sent a line without an end
            pass
        finally:
            self._connected -= 1
            writer.close()


def _carry_out(line: bytes, bench: _Bench, busy: Callable[[], bool]) -> str:
    """Carry out one order; return why not, empty when it was done."""
    try:
        order = json.loads(line)
        for kind, values in order.items():
            domains = _DOMAINS[kind]
            wrong = [name for name, fits in domains.items() if not fits(values[name])]
            if wrong or set(values) != set(domains):
                return f"{', '.join(wrong) or kind}: out of its domain"
            if busy():
                return "an acquisition is running"
            setter = bench.set_fixture if kind == "fixture" else bench.set_handling
            setter(**values)
    except UsageError as error:
        return error.what
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return "no order of a simulated operator"
    return ""
