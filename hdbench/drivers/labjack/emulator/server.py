"""Server of the emulated device on two TCP ports: control and stream."""

from __future__ import annotations

import asyncio
import errno
import struct
from collections.abc import Callable, Mapping

from hdbench.devices.emulator.server import Device, ModbusRefusedError, ModbusServer, Space
from hdbench.devices.emulator.serving import Emulation, EmulatorSettings
from hdbench.drivers.labjack.emulator.device import LabJackDevice
from hdbench.drivers.labjack.emulator.memory import RefusedError
from hdbench.drivers.labjack.emulator.streaming import Wiring
from hdbench.drivers.labjack.table import LabJackAcquisition
from hdbench.errors import DeviceError

# 502 and 702
STREAM_OFFSET = 200
_ILLEGAL_VALUE = 3
# a reader that has not taken this much is slow: packets then wait in the device's buffer
_SLOW_BYTES = 16384
_PORT_TRIES = 50
_HIGHEST_PORT = 65535


class LabJackServer(Device):
    """Serves one device until it is closed."""

    functions = frozenset((3, 6, 16, 76))
    # larger than Modbus has them: a feedback request may fill a packet of Ethernet
    longest = 1040

    def __init__(self, device: LabJackDevice) -> None:
        self.device = device
        self.change_packets: Callable[[bytes], list[bytes]] = lambda packet: [packet]
        self._control: ModbusServer | None = None
        self._stream: asyncio.Server | None = None
        self._readers: set[asyncio.WriteTransport] = set()
        device.rebooted = self._hang_up

    async def open(self, host: str, port: int) -> tuple[str, int]:
        """Listen on `port` and on `port` + 200; port 0 takes a free pair."""
        loop = asyncio.get_running_loop()
        for attempt in range(1, _PORT_TRIES + 1):
            control = ModbusServer(self)
            address = await control.open(host, port)
            bound = int(address.rpartition(":")[2])
            try:
                if bound + STREAM_OFFSET > _HIGHEST_PORT:
                    raise OSError(errno.EADDRNOTAVAIL, "no port left for the stream")
                stream = await loop.create_server(
                    lambda: _Reader(self._readers), host, bound + STREAM_OFFSET
                )
            except OSError:
                control.close()
                if port or attempt == _PORT_TRIES:
                    raise
                continue
            break
        self._control, self._stream = control, stream
        return host, bound

    def close(self) -> None:
        """Stop listening and end every connection."""
        if self._control is not None:
            self._control.close()
        if self._stream is not None:
            self._stream.close()
        self._hang_up()

    def hears(self, function: int) -> bool:
        """Feed the watchdog."""
        self.device.watchdog.heard()
        self.device.watchdog.tick()
        return True

    def read(self, space: Space, address: int, count: int, connection: int) -> bytes:
        """Return registers."""
        return self._swapped(self.device.memory.read(address, count))

    def write(self, space: Space, address: int, raw: bytes, connection: int) -> None:
        """Write registers."""
        self.device.memory.write(address, raw)

    def note_refusal(self, refused: ModbusRefusedError, connection: int, transaction: int) -> None:
        """Keep it for LAST_ERR_*; what is no request at all has its exception as its reason."""
        if not isinstance(refused, RefusedError):
            refused = RefusedError(refused.exception, refused.exception)
        self.device.note_error(refused, transaction)

    def tick(self) -> None:
        """Let the device act, and send the packets that are complete."""
        # with nobody there yet, packets wait in the device's buffer, too
        slow = not self._readers or any(
            reader.get_write_buffer_size() > _SLOW_BYTES for reader in self._readers
        )
        for packet in self.device.tick(blocked=slow):
            for changed in self.change_packets(packet):
                for reader in self._readers:
                    reader.write(changed)

    def other(self, pdu: bytes) -> bytes:
        """Carry out a feedback request: reads and writes one after the other."""
        frames, reply = pdu[1:], b""
        while frames:
            if len(frames) < 4:
                raise RefusedError(_ILLEGAL_VALUE, _ILLEGAL_VALUE)
            kind, address, count = struct.unpack(">BHB", frames[:4])
            frames = frames[4:]
            if kind == 0:
                reply += self._swapped(self.device.memory.read(address, count))
            elif kind == 1 and len(frames) >= 2 * count:
                self.device.memory.write(address, frames[: 2 * count])
                frames = frames[2 * count :]
            else:
                raise RefusedError(_ILLEGAL_VALUE, _ILLEGAL_VALUE)
        return reply

    def _swapped(self, raw: bytes) -> bytes:
        """Return 32-bit values with their words swapped, where a gateway is to do that."""
        if not self.device.swap_words or len(raw) % 4:
            return raw
        return b"".join(raw[n + 2 : n + 4] + raw[n : n + 2] for n in range(0, len(raw), 4))

    def _hang_up(self) -> None:
        if self._control is not None:
            self._control.hang_up()
        for transport in tuple(self._readers):
            transport.abort()


class _Reader(asyncio.Protocol):
    """One connection to the stream; nothing that it sends matters."""

    def __init__(self, readers: set[asyncio.WriteTransport]) -> None:
        self._readers = readers
        self._transport: asyncio.WriteTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Send to it from now on."""
        if isinstance(transport, asyncio.WriteTransport):
            self._transport = transport
            self._readers.add(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Send nothing more to it."""
        if self._transport is not None:
            self._readers.discard(self._transport)


class EmulatedLabJack:
    """Implements `hdbench.devices.emulator.serving.EmulatedDevice`."""

    def __init__(self, device: LabJackDevice) -> None:
        self.server = LabJackServer(device)

    async def open(self, settings: EmulatorSettings) -> Mapping[str, object]:
        """Listen on a pair of ports; return ``address`` and ``stream_port``."""
        try:
            host, port = await self.server.open(settings.host, settings.port)
        except OSError as error:
            raise DeviceError(
                f"cannot listen on ports {settings.port} and {settings.port + STREAM_OFFSET} "
                f"({error.strerror or error})",
                where=f"{settings.host}:{settings.port}",
                fix="choose another port, or 0 for a free pair",
            ) from error
        return {"address": f"tcp://{host}:{port}", "stream_port": port + STREAM_OFFSET}

    def close(self) -> None:
        """Stop listening and end every connection."""
        self.server.close()


def emulate_labjack(emulation: Emulation, table: LabJackAcquisition) -> EmulatedLabJack:
    """Return a device with a simulated bench at the terminals that `table` names."""
    # the instrument's current channel has max_current_a at range_v; the terminal has 1 V per scale
    profile = emulation.profile
    current = next((c for c in table.channels if c.role == "current"), None)
    amperes_per_v = profile.servo.max_current_a / profile.daq.range_v
    factor = 1.0 if current is None else amperes_per_v / current.scale
    wiring = Wiring(emulation.instrument, table, current_v_per_v=factor, seed=emulation.seed)
    return EmulatedLabJack(LabJackDevice(wiring, serial_number(emulation.seed)))


def serial_number(seed: int) -> int:
    """Return the serial number that an emulated device has with this seed."""
    return seed % 999_999_999 + 1
