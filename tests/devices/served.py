"""An emulated device in a thread of this process, and what a driver reads of it."""

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from hdbench.devices import safestate
from hdbench.devices.bench import Bench, Block, SafeState
from hdbench.devices.daq import Daq, ScanBlock
from hdbench.devices.emulator.instrument import SimulatedInstrument
from hdbench.devices.emulator.memory import Memory


@dataclass
class InThread:
    """Base of a device that is served by the event loop of another thread."""

    loop: asyncio.AbstractEventLoop

    def call(self, act: Callable[[], Any]) -> Any:
        """Run `act` in the device's thread."""

        async def run() -> Any:
            return act()

        return asyncio.run_coroutine_threadsafe(run(), self.loop).result(5)


def read_all(daq: Daq, *, timeout_s: float = 20.0) -> list[ScanBlock]:
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


def read_samples(bench: Bench, n_samples: int) -> list[Block]:
    """Read until so many samples have come, or are told as lost."""
    blocks: list[Block] = []
    while sum(len(block) + block.lost_before for block in blocks) < n_samples:
        block = bench.read_block()
        if block is not None:
            blocks.append(block)
    return blocks


def not_made_safe(bench: Bench | Daq) -> SafeState:
    """Ask for a safe state that cannot be reached, for half a second: test_node has 2.5 s."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(safestate, "_TIMEOUT_S", 0.5)
        safe = bench.safe_state()
    assert not safe.confirmed
    return safe


def disturb(instrument: SimulatedInstrument, **held_v: float) -> None:
    """Hold inputs at these volts, whatever stands at their terminals; the others are mended."""

    def produce(count: int) -> Any:
        samples = SimulatedInstrument._produce(instrument, count)
        for channel, value_v in held_v.items():
            samples.volts[channel][:] = value_v
        return samples

    instrument._produce = produce


def swap_words(memory: Memory) -> None:
    """Let a gateway swap the words of every 32-bit value that is read."""
    read = memory.read

    def swapped(*asked: Any) -> bytes:
        raw = read(*asked)
        return raw[2:] + raw[:2] if len(raw) == 4 else raw

    memory.read = swapped
