"""An emulated T7 in a thread of this process, and a driver that talks to it."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdbench.devices.daq import DaqSettings, ScanBlock
from hdbench.devices.driver import open_daq
from hdbench.devices.emulator.instrument import DeviceClock, SimulatedInstrument
from hdbench.drivers.labjack.driver import LabJackDaq
from hdbench.drivers.labjack.emulator.device import LabJackDevice
from hdbench.drivers.labjack.emulator.server import LabJackServer
from hdbench.drivers.labjack.emulator.streaming import Wiring
from hdbench.plant.bench import SimulatedBench
from hdbench.plant.plantfile import load_plant
from hdbench.profile import load_profile

PROFILE = load_profile("labjack-t7").data
ROLES = ("torque", "tacho", "current", "reference", "encoder")


@dataclass
class Served:
    """An emulated device in a thread."""

    server: LabJackServer
    instrument: SimulatedInstrument
    host: str
    port: int
    loop: asyncio.AbstractEventLoop
    events: list[dict[str, object]]

    @property
    def device(self) -> LabJackDevice:
        return self.server.device

    def call(self, act: Callable[[], Any]) -> Any:
        """Run `act` in the device's thread."""

        async def run() -> Any:
            return act()

        return asyncio.run_coroutine_threadsafe(run(), self.loop).result(5)


@contextmanager
def served(
    *, speed: float = 1.0, seed: int = 3, table: Any = None, count_joint: bool = False
) -> Iterator[Served]:
    """Serve a device on a free pair of ports."""
    events: list[dict[str, object]] = []
    instrument = SimulatedInstrument(
        SimulatedBench(PROFILE, load_plant("as-modelled"), seed),
        PROFILE.encoder.counts_per_turn,
        clock=DeviceClock(speed, time.monotonic()),
        record=lambda event: events.append(dict(event)),
    )
    wiring = Wiring(instrument, table or PROFILE.daq, current_v_per_v=1.0, seed=seed)
    server = LabJackServer(LabJackDevice(wiring, seed, count_joint=count_joint))
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    host, port = asyncio.run_coroutine_threadsafe(server.open("127.0.0.1", 0), loop).result(5)
    try:
        yield Served(server, instrument, host, port, loop, events)
    finally:

        async def shut() -> None:
            server.close()
            # one turn of the loop closes what is open
            await asyncio.sleep(0.01)

        asyncio.run_coroutine_threadsafe(shut(), loop).result(5)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(5)
        loop.close()


def table_for(port: int, **changes: Any) -> Any:
    """Return the profile's table with the address of a served device."""
    return PROFILE.daq.model_copy(update={"address": f"tcp://127.0.0.1:{port}", **changes})


@contextmanager
def driver(port: int, **changes: Any) -> Iterator[LabJackDaq]:
    """Open a driver."""
    daq = open_daq(PROFILE, table_for(port, **changes))
    try:
        yield daq
    finally:
        daq.close()


def settings(n_samples: int, period_s: float = 1e-3, roles: tuple[str, ...] = ROLES) -> DaqSettings:
    """Return an acquisition of `n_samples`."""
    return DaqSettings(roles, period_s, n_samples, 1.0)


def read_all(daq: LabJackDaq, *, timeout_s: float = 20.0) -> list[ScanBlock]:
    """Read until the last block."""
    blocks: list[ScanBlock] = []
    until_s = time.monotonic() + timeout_s
    while time.monotonic() < until_s:
        block = daq.read_block()
        if block is None:
            continue
        blocks.append(block)
        if not block.running and block.depth == 0:
            return blocks
    raise AssertionError(f"not finished within {timeout_s} s")


def values(blocks: list[ScanBlock]) -> np.ndarray:
    """Return all scans of adjacent blocks."""
    return np.concatenate([block.values for block in blocks])
