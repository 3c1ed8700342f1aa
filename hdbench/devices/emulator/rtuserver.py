"""The emulated node on a serial line: Modbus RTU framing on a pseudo-terminal."""

from __future__ import annotations

import asyncio

from hdbench.devices.emulator.answer import answer
from hdbench.devices.emulator.core import NodeCore
from hdbench.devices.wire.crc import crc16
from hdbench.system.lines import PseudoTerminal

__all__ = ["RtuNodeServer", "request_size"]

# wall-clock grain of watchdog, real-time samples and deceleration
_TICK_S = 0.005
# after a damaged request nothing is answered until the line was quiet for this long
_QUIET_S = 0.005
# a serial line shows no host go: without a request for this long its session counts as left
_SILENCE_S = 2.0
_CONNECTION = 0


def request_size(data: bytes) -> int | None:
    """Return the length of the request that begins with `data`; None while it cannot be told.

    Parameters
    ----------
    data : bytes
        What has come so far, from the unit identifier on.

    Returns
    -------
    int or None
        Characters with the checksum; 0 where no request begins so.
    """
    if len(data) < 2:
        return None
    function = data[1]
    if function in (1, 2, 3, 4, 5, 6):
        return 8
    counted = {15: 6, 16: 6, 23: 10}.get(function)
    if counted is None:
        return 0
    return None if len(data) <= counted else counted + 3 + data[counted]


class RtuNodeServer:
    """Serves one node on a pseudo-terminal until it is closed.

    Parameters
    ----------
    core : NodeCore
        The node.
    unit : int
        Modbus unit identifier; requests to others are not answered.
    """

    def __init__(self, core: NodeCore, unit: int = 1) -> None:
        self.core = core
        self._unit = unit
        self._line: PseudoTerminal | None = None
        self._buffer = b""
        self._deaf = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._quiet: asyncio.TimerHandle | None = None
        self._heard_s = 0.0
        self._present = False

    async def open(self) -> str:
        """Open a pseudo-terminal and return the path that a host opens.

        Raises
        ------
        OSError
            If there is none.
        """
        self._loop = asyncio.get_running_loop()
        self._line = PseudoTerminal(self._received)
        self._tick()
        return self._line.path

    def close(self) -> None:
        """End the line."""
        if self._loop is None:
            return
        for timer in (self._timer, self._quiet):
            if timer is not None:
                timer.cancel()
        if self._line is not None:
            self._line.close()
        self._loop = None

    def _tick(self) -> None:
        if self._loop is None:
            return
        self.core.tick()
        if self._present and self._loop.time() - self._heard_s > _SILENCE_S:
            self._present = False
            self.core.disconnected(_CONNECTION)
        self._timer = self._loop.call_later(_TICK_S, self._tick)

    def _received(self, data: bytes) -> None:
        if self._loop is None:
            return
        self._heard_s, self._present = self._loop.time(), True
        if self._deaf:
            self._turn_deaf()
            return
        self._buffer += data
        while (size := request_size(self._buffer)) is not None and len(self._buffer) >= size:
            frame, self._buffer = self._buffer[:size], self._buffer[size:]
            if not frame or crc16(frame[:-2]) != frame[-2:]:
                self._turn_deaf()
                return
            if frame[0] == self._unit:
                self._answer(frame[1:-2])
        # the reply is on its way: produce while the host works on it
        self._loop.call_soon(self.core.machine.produce_ahead)

    def _answer(self, pdu: bytes) -> None:
        self.core.machine.tick()
        reply = bytes((self._unit,)) + answer(pdu, self.core, _CONNECTION)
        if self._line is not None:
            # where nobody reads, the line is full, and the reply is lost as on a real one
            self._line.write(reply + crc16(reply))

    def _turn_deaf(self) -> None:
        """Drop what came, and listen again once the line has been quiet."""
        if self._loop is None:
            return
        self._buffer, self._deaf = b"", True
        if self._quiet is not None:
            self._quiet.cancel()
        self._quiet = self._loop.call_later(_QUIET_S, self._listen)

    def _listen(self) -> None:
        self._deaf = False
