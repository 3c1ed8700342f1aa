"""The emulated instrument on a pseudo-terminal."""

from __future__ import annotations

import asyncio

from hdbench.drivers.dataq.emulator.device import DataqDevice
from hdbench.system.lines import PseudoTerminal

__all__ = ["DataqLine"]

# wall-clock grain of the stream, s
_TICK_S = 0.005


class DataqLine:
    """Serves one instrument until it is closed.

    Parameters
    ----------
    device : DataqDevice
        The instrument.
    """

    def __init__(self, device: DataqDevice) -> None:
        self.device = device
        self._line: PseudoTerminal | None = None
        self._buffer = self._left = b""
        self._timer: asyncio.TimerHandle | None = None

    async def open(self) -> str:
        """Open a pseudo-terminal and return the address that a host opens."""
        self._line = PseudoTerminal(self._received)
        self._tick()
        return f"serial://{self._line.path}"

    def close(self) -> None:
        """End the line."""
        if self._timer is not None:
            self._timer.cancel()
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def _tick(self) -> None:
        self._left = self._send(self._left)
        self._left += self.device.tick(blocked=bool(self._left))
        self._left = self._send(self._left)
        self._timer = asyncio.get_running_loop().call_later(_TICK_S, self._tick)

    def _received(self, data: bytes) -> None:
        self._buffer += data
        *lines, self._buffer = self._buffer.split(b"\r")
        for line in lines:
            self._left += self.device.command(line.decode("ascii", errors="replace").strip())
        self._left = self._send(self._left)

    def _send(self, data: bytes) -> bytes:
        """Send what the line takes; return the rest."""
        while data and self._line is not None and (sent := self._line.write(data)):
            data = data[sent:]
        return data
