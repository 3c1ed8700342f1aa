"""An emulated DATAQ instrument in a thread of this process, and a driver that talks to it."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from hdbench.devices.daq import DaqSettings, ScanBlock
from hdbench.devices.emulator.instrument import SimulatedInstrument
from hdbench.devices.emulator.serving import Emulation
from hdbench.drivers.dataq.driver import DataqDaq, open_dataq
from hdbench.drivers.dataq.emulator import DataqDevice, DataqLine, emulate_dataq
from hdbench.drivers.dataq.table import DataqAcquisition
from hdbench.profile import load_profile

BENCH = load_profile("cim-tr-97-06").data
ROLES = ("torque", "tacho", "current", "reference")


def table(model: str = "DI-2108", roles: tuple[str, ...] = ROLES, **keys: Any) -> DataqAcquisition:
    """Return a table with one input per role."""
    range_v = keys.pop("range_v", 5.0 if model == "DI-4718B" else 10.0)
    channels = tuple(
        {
            "role": role,
            "input": "counter" if role == "encoder" else f"analog {number}",
            "range_v": range_v,
        }
        for number, role in enumerate(roles)
    )
    return DataqAcquisition.model_validate(
        {"driver": "dataq", "model": model, "sample_period_s": 0.001, "channels": channels, **keys}
    )


@dataclass
class Served:
    """An emulated instrument in a thread."""

    device: DataqDevice
    line: DataqLine
    instrument: SimulatedInstrument
    address: str
    loop: asyncio.AbstractEventLoop

    def call(self, act: Callable[[], Any]) -> Any:
        """Run `act` in the device's thread."""

        async def run() -> Any:
            return act()

        return asyncio.run_coroutine_threadsafe(run(), self.loop).result(5)


@contextmanager
def served(what: DataqAcquisition, *, speed: float = 1.0, seed: int = 3) -> Iterator[Served]:
    """Serve an instrument on a pseudo-terminal."""
    emulation = Emulation(BENCH, "as-modelled", seed)
    emulation.speed = speed
    instrument, line = emulation.instrument, emulate_dataq(emulation, what).line
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    address = asyncio.run_coroutine_threadsafe(line.open(), loop).result(5)
    try:
        yield Served(line.device, line, instrument, address, loop)
    finally:

        async def shut() -> None:
            line.close()

        asyncio.run_coroutine_threadsafe(shut(), loop).result(5)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(5)
        loop.close()


@contextmanager
def driver(what: DataqAcquisition, address: str, **changes: Any) -> Iterator[DataqDaq]:
    """Open a driver at an address."""
    daq = open_dataq(BENCH, what.model_copy(update={"address": address, **changes}))
    try:
        yield daq
    finally:
        daq.close()


def settings(n_samples: int, period_s: float = 1e-3, roles: tuple[str, ...] = ROLES) -> DaqSettings:
    """Return an acquisition."""
    return DaqSettings(roles, period_s, n_samples, 1.0)  # type: ignore[arg-type]


def read_all(daq: DataqDaq, *, timeout_s: float = 10.0) -> list[ScanBlock]:
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
