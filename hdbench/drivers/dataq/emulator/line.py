"""The emulated instrument on a pseudo-terminal."""

from __future__ import annotations

import asyncio
import os
import tty

from hdbench.drivers.dataq.emulator.device import DataqDevice

__all__ = ["DataqLine"]

# wall-clock grain of the stream, s
_TICK_S = 0.005
_CHUNK = 4096


class DataqLine:
    """Serves one instrument until it is closed.

    Parameters
    ----------
    device : DataqDevice
        The instrument.
    """

    def __init__(self, device: DataqDevice) -> None:
        self.device = device
        self._master = self._slave = -1
        self._buffer = self._left = b""
        self._timer: asyncio.TimerHandle | None = None

    async def open(self) -> str:
        """Open a pseudo-terminal and return the address that a host opens.

        Raises
        ------
        OSError
            If there is none.
        """
        # the other end stays open here, so that a host that leaves does not end the line
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        asyncio.get_running_loop().add_reader(self._master, self._received)
        self._tick()
        return f"serial://{os.ttyname(self._slave)}"

    def close(self) -> None:
        """End the line."""
        if self._timer is not None:
            self._timer.cancel()
        if self._master >= 0:
            asyncio.get_running_loop().remove_reader(self._master)
            os.close(self._master)
            os.close(self._slave)
            self._master = self._slave = -1

    def _tick(self) -> None:
        self._left = self._send(self._left)
        self._left += self.device.tick(blocked=bool(self._left))
        self._left = self._send(self._left)
        self._timer = asyncio.get_running_loop().call_later(_TICK_S, self._tick)

    def _received(self) -> None:
        self._buffer += os.read(self._master, _CHUNK)
        *lines, self._buffer = self._buffer.split(b"\r")
        for line in lines:
            self._left += self.device.command(line.decode("ascii", errors="replace").strip())
        self._left = self._send(self._left)

    def _send(self, data: bytes) -> bytes:
        """Send what the line takes; return the rest."""
        while data:
            try:
                data = data[os.write(self._master, data) :]
            except BlockingIOError:
                break
        return data
