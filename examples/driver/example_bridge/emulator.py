"""The amplifier around a simulated bench, on a loopback port (pyserial's ``socket://``)."""

import asyncio

from .bridge import RANGE_V

_STEP_V = RANGE_V / 2**23
_MOST = 64  # samples of one answer


class EmulatedBridge:
    """Implements `hdbench.devices.emulator.serving.EmulatedDevice`."""

    def __init__(self, emulation, table):
        self._bench = emulation.instrument
        self._identity = f"Example,BR-1,sim-{emulation.seed},1.0"
        self._period_s = table.sample_period_s
        self._taken, self._server = [], None

    async def open(self, settings):
        """Listen, and return the address that a host opens."""
        self._server = await asyncio.start_server(self._talk, settings.host, settings.port)
        host, port = self._server.sockets[0].getsockname()[:2]
        return {"address": f"socket://{host}:{port}"}

    def close(self):
        """Listen no more."""
        self._server.close()

    async def _talk(self, reader, writer):
        try:
            while True:
                line = (await reader.readuntil(b"\r")).decode("ascii", errors="replace").strip()
                writer.write(f"{line}={self._answer(*line.split())}\r".encode())
                await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError):
            writer.close()

    def _answer(self, command, value="0"):
        if command == "*IDN?":
            return self._identity
        if command == "READ?":
            self._taken += self._volts(self._bench.take(_MOST))
            return ",".join(self._taken[int(value) :][:_MOST])
        if command == "PERIOD":
            self._period_s = float(value)
        elif command == "START":
            self._taken = []
            self._bench.begin(self._period_s)
        elif command == "STOP" and self._bench.sampling:
            self._bench.end()
        return "OK"

    def _volts(self, samples):
        """Return what the converter makes of the amplified bridge: 24 bits of +-10 V."""
        volts = samples.volts["torque"].clip(-RANGE_V, RANGE_V)
        return [f"{_STEP_V * round(one / _STEP_V):.7f}" for one in volts]
