"""Service of emulated devices around one simulated bench, in a session or as a command."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from pathlib import Path
from typing import IO, Annotated, Any, Literal, Protocol

from pydantic import Field, ValidationError

from hdbench.devices.driver import driver_of
from hdbench.devices.emulator.instrument import SimulatedInstrument, Terminal, device_clock
from hdbench.devices.emulator.machine import Pace
from hdbench.devices.emulator.server import Device, ModbusServer, Wire
from hdbench.errors import DeviceError, StorageError, UsageError
from hdbench.plant.bench import SimulatedBench
from hdbench.plant.plantfile import load_plant
from hdbench.profile.acquiring import Acquisition
from hdbench.profile.schema import ProfileData
from hdbench.profile.tables import Table

_POLL_S = 0.01


class _Fixture(Table):
    locked: bool
    position_rad: Annotated[float, Field(ge=-1e3, le=1e3)]
    mass_kg: Annotated[float, Field(ge=0.0, le=1e3)]
    direction: Literal[-1, 1]


class _Handling(Table):
    swing_rad: Annotated[float, Field(ge=0.0, le=0.5)]
    release_s: Annotated[float, Field(ge=0.0, le=1e4)]
    shunt_ohm: Annotated[float, Field(ge=0.0, le=1e9)]


class _Order(Table):
    fixture: _Fixture | None = None
    handling: _Handling | None = None


class Channel:
    """Listens on a free loopback port for a simulated operator.

    Parameters
    ----------
    bench : callable
        Gives the bench of this moment: lock, arm and weights.
    busy : callable
        Whether nobody can reach into the bench now.
    """

    def __init__(self, bench: Callable[[], SimulatedBench], busy: Callable[[], bool]) -> None:
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
                refused = self._carry_out(line)
                answer = {"refused": refused} if refused else {"ok": True}
                writer.write(json.dumps(answer).encode() + b"\n")
                await writer.drain()
        except (OSError, ValueError):
            # it hung up, or sent a line without an end
            pass
        finally:
            self._connected -= 1
            writer.close()

    def _carry_out(self, line: bytes) -> str:
        """Carry out one order; return why not, empty when it was done."""
        try:
            order = _Order.model_validate_json(line)
            if order.model_fields_set and self._busy():
                return "an acquisition is running"
            if order.fixture is not None:
                self._bench().set_fixture(**order.fixture.model_dump())
            if order.handling is not None:
                self._bench().set_handling(**order.handling.model_dump())
        except ValidationError as error:
            key = ".".join(map(str, error.errors()[0]["loc"]))
            return f"{key}: out of its domain" if key else "no order of a simulated operator"
        except UsageError as error:
            return error.what
        return ""


# that a host-written reference and two wires keep up with
_FAST_COMPOSITE = 4.0
# time in which devices that have lost their host must have stopped the motor: watchdog and braking
_ORPHAN_S = 7.0


def open_record(path: Path | None, stack: ExitStack) -> Callable[[Mapping[str, object]], None]:
    """Return what writes one JSON line per event."""
    if path is None:
        return lambda _: None
    try:
        file: IO[str] = stack.enter_context(path.open("w", encoding="utf-8", buffering=1))
    except OSError as error:
        raise StorageError(
            f"cannot be written ({error.strerror})", where=str(path), fix="choose another file"
        ) from error

    def record(event: Mapping[str, object]) -> None:
        file.write(json.dumps(event, allow_nan=False) + "\n")

    return record


def ending(lifeline: int | None) -> asyncio.Event:
    """Return what is set by SIGTERM, by Ctrl-C where there is no lifeline, or by its end."""
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()

    def end(*_: object) -> None:
        # perhaps the loop has ended meanwhile
        with suppress(RuntimeError):
            loop.call_soon_threadsafe(ended.set)

    signal.signal(signal.SIGTERM, end)
    if lifeline is None:
        signal.signal(signal.SIGINT, end)
    else:
        threading.Thread(target=_until_end, args=(lifeline, end), daemon=True).start()
    return ended


def _until_end(descriptor: int, end: Callable[[], None]) -> None:
    """Wait for the end of a file in a thread: no loop can wait for a pipe on every system."""
    with suppress(OSError):
        while os.read(descriptor, 1):
            pass
    end()


@dataclass(frozen=True, slots=True)
class EmulatorSettings:
    """How an emulated device is served.

    Parameters
    ----------
    host : str
        Address to listen on; Modbus has no authentication, so keep it on the loopback.
    port : int
        TCP port; 0 takes a free one. Of a composite it is the first one's.
    pace : {"realtime", "fast"}
        Samples by the wall clock, or as fast as the host reads them.
    record : Path or None
        File for one JSON line per change of state.
    lifeline : int or None
        File descriptor whose end of file ends the emulator, once its motor stands.
    wire : str
        What a device of registers speaks; see `hdbench.devices.emulator.server.Wire`.
    """

    host: str = "127.0.0.1"
    port: int = 0
    pace: Pace = "realtime"
    record: Path | None = None
    lifeline: int | None = None
    wire: Wire = "tcp"


class EmulatedDevice(Protocol):
    """One device at the terminals of a simulated bench that it may share with another one."""

    async def open(self, settings: EmulatorSettings) -> Mapping[str, object]:
        """Open its wire and return the keys of its table as it has them, ``address`` at least.

        Raises `OSError` if the wire cannot be used.
        """
        ...

    def close(self) -> None:
        """Close its wire."""


@dataclass(eq=False)
class ModbusWire:
    """The wire of a device of registers; implements `EmulatedDevice`.

    Parameters
    ----------
    device : Device
        The device.
    queries : mapping, optional
        Wires that it speaks, each with what follows its address; left out, it speaks all.
    on_line : bool
        Whether it is on a serial line where nothing else is asked for.
    """

    device: Device
    queries: Mapping[Wire, str] | None = None
    _: KW_ONLY
    on_line: bool = False

    def __post_init__(self) -> None:
        self._server: ModbusServer | None = None

    async def open(self, settings: EmulatorSettings) -> Mapping[str, object]:
        """Open the wire and return ``address``."""
        wire = "rtu" if self.on_line and settings.wire == "tcp" else settings.wire
        if self.queries is not None and wire not in self.queries:
            raise UsageError(
                f"a node speaks no {wire}",
                where="--wire",
                fix="choose tcp or rtu, or a profile with a polled Modbus device",
            )
        self._server = ModbusServer(self.device, wire)
        address = await self._server.open(settings.host, settings.port)
        return {"address": address + (self.queries or {}).get(wire, "")}

    def close(self) -> None:
        """Close the wire."""
        if self._server is not None:
            self._server.close()


@dataclass(eq=False)
class Emulation:
    """One simulated bench, for the devices around it.

    Parameters
    ----------
    profile : ProfileData
        The bench.
    plant : str
        Name or path of the plant.
    seed : int
        Seed of everything simulated, at least 0.
    pace : {"realtime", "fast"}
        What was asked for.
    model_file : Path, optional
        Extended model to simulate in place of the profile's.
    record : callable, optional
        Takes one mapping per change of state and while the motor turns.

    Attributes
    ----------
    moving : callable
        Whether the motor moves; a device that moves it by itself puts its own here.
    busy : callable
        Whether nobody can reach into the bench now; likewise.
    """

    profile: ProfileData
    plant: str
    seed: int
    _: KW_ONLY
    pace: Pace = "realtime"
    model_file: Path | None = None
    record: Callable[[Mapping[str, object]], None] = lambda _: None

    def __post_init__(self) -> None:
        self.speed = emulated_speed(self.profile.daq, self.pace)
        self.moving: Callable[[], bool] = lambda: self.instrument.moving
        self.busy: Callable[[], bool] = lambda: False

    @cached_property
    def bench(self) -> SimulatedBench:
        """Drive, load and sensor, for a device that makes the motor reference itself."""
        from hdbench.model.modelfile import load_model

        model = load_model(self.model_file) if self.model_file else None
        return SimulatedBench(self.profile, load_plant(self.plant), self.seed, model=model)

    @cached_property
    def instrument(self) -> SimulatedInstrument:
        """The bench at electrical terminals, for devices whose host writes the reference."""
        return SimulatedInstrument(
            self.bench,
            self.profile.encoder.counts_per_turn,
            clock=device_clock(self.speed),
            record=self.record,
        )

    @property
    def amperes_per_v(self) -> float:
        """Motor current per volt of the instrument's current channel, A/V."""
        return self.profile.servo.max_current_a / self.profile.daq.range_v

    def terminals(self, channels: Iterable[Any]) -> dict[int, Terminal]:
        """Return what is wired to the analog inputs of a table, by their numbers."""
        factors = {"current": self.amperes_per_v}
        return {
            channel.number: (channel.role, factors.get(channel.role, 1.0) / channel.scale)
            for channel in channels
            if channel.role != "encoder"
        }

    @property
    def hosted(self) -> bool:
        """Whether a host writes the motor reference."""
        return "instrument" in self.__dict__


def emulate(
    profile: ProfileData,
    plant: str,
    seed: int,
    settings: EmulatorSettings,
    *,
    ready: Callable[[Mapping[str, object]], None],
    model_file: Path | None = None,
) -> None:
    """Serve the devices of a profile until SIGTERM, Ctrl-C or the lifeline's end."""
    with ExitStack() as stack:
        emulation = Emulation(
            profile,
            plant,
            seed,
            pace=settings.pace,
            model_file=model_file,
            record=open_record(settings.record, stack),
        )
        devices = {
            name: _emulated(table, emulation) for name, table in profile.daq.part_tables().items()
        }
        asyncio.run(_serve(emulation, devices, settings, ready))


def emulated_speed(table: Acquisition, pace: Pace) -> float:
    """Return how many device seconds pass in a second where a host writes the reference."""
    if pace != "fast":
        return 1.0
    first, *others = table.part_tables().values()
    speed = driver_of(first.driver).emulated_speed
    return min(speed, _FAST_COMPOSITE) if others else speed


def _emulated(table: Acquisition, emulation: Emulation) -> EmulatedDevice:
    make = driver_of(table.driver).emulate
    if make is None:
        raise UsageError(
            f"driver {table.driver!r} has no emulator",
            where="key daq.address",
            fix="name the address of a real device, or choose another driver",
        )
    return make(emulation, table)


async def _serve(
    emulation: Emulation,
    devices: Mapping[str, EmulatedDevice],
    settings: EmulatorSettings,
    ready: Callable[[Mapping[str, object]], None],
) -> None:
    ended = ending(settings.lifeline)
    found: dict[str, Mapping[str, object]] = {}
    for name, device in devices.items():
        try:
            found[name] = await device.open(settings)
        except OSError as error:
            raise DeviceError(
                f"the wire{f' of the {name}' if name else ''} cannot be opened "
                f"({error.strerror or error})",
                where="serial line"
                if settings.wire in ("rtu", "ascii")
                else f"{settings.host}:{settings.port}",
                fix="choose another port, or 0 for a free one",
            ) from error
    bench = emulation.instrument.present if emulation.hosted else lambda: emulation.bench
    channel = Channel(bench, emulation.busy)
    control = await channel.open()
    keys = found.get("", {"address": "parts", **found})
    ready({**keys, **({"speed": emulation.speed} if emulation.hosted else {}), "control": control})
    await ended.wait()
    if settings.lifeline is not None:
        await channel.left()
        # an orphaned device still has to stop its motor: its watchdog gets its time
        until_s = time.monotonic() + _ORPHAN_S
        while emulation.moving() and time.monotonic() < until_s:
            await asyncio.sleep(_POLL_S)
    channel.close()
    for device in devices.values():
        device.close()
