"""An emulated device in a thread of this process, and what a driver reads of it."""

import asyncio
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hdbench.devices import safestate
from hdbench.devices.bench import AcquisitionSettings, Bench, Block, SafeState
from hdbench.devices.daq import Daq, ScanBlock
from hdbench.devices.emulator.instrument import SimulatedInstrument
from hdbench.devices.emulator.memory import Memory
from hdbench.profile.schema import ReferenceWave

WAVE = ReferenceWave(wave="constant", amplitude_v=1.0)
CHANNELS = ("torque_v", "tacho_v", "motor_current_a", "reference_v", "encoder_count")


@dataclass
class InThread:
    """Base of a device that is served by the event loop of another thread."""

    loop: asyncio.AbstractEventLoop

    def call(self, act: Callable[[], Any]) -> Any:
        """Run `act` in the device's thread."""

        async def run() -> Any:
            return act()

        return asyncio.run_coroutine_threadsafe(run(), self.loop).result(5)


def given(daq: Any) -> Iterator[Any]:
    """Yield the blocks that come, one after the other, for a minute at most."""
    until_s = time.monotonic() + 60.0
    while time.monotonic() < until_s:
        block = daq.read_block()
        if block is not None:
            yield block
    raise AssertionError("not finished within a minute")


def read_all(daq: Any, into: list[Any] | None = None) -> list[Any]:
    """Read until the last block; `into` keeps what came before an error."""
    blocks = [] if into is None else into
    for block in given(daq):
        blocks.append(block)
        if not block.running and block.depth == 0:
            break
    return blocks


def begin(daq: Any, settings: Any) -> None:
    """Start an acquisition."""
    daq.configure(settings)
    daq.start()


def acquired(daq: Any, settings: Any) -> list[Any]:
    """Return the blocks of a whole acquisition."""
    begin(daq, settings)
    return read_all(daq)


def values(blocks: list[ScanBlock]) -> np.ndarray:
    """Return all scans of adjacent blocks."""
    return np.concatenate([block.values for block in blocks])


def lost(blocks: list[Any]) -> int:
    """Return how many samples are told as lost."""
    return sum(block.lost_before for block in blocks)


def gaps(blocks: list[Any], n_samples: int) -> int:
    """Hold every index as delivered or told as lost, in order; return how many are lost."""
    expected = 0
    for block in blocks:
        assert block.first_index == expected + block.lost_before
        expected = block.first_index + len(block)
    assert expected == n_samples
    return lost(blocks)


def read_samples(bench: Bench, n_samples: int) -> list[Block]:
    """Read until so many samples have come, or are told as lost."""
    blocks: list[Block] = []
    for block in given(bench):
        blocks.append(block)
        n_samples -= len(block) + block.lost_before
        if n_samples <= 0:
            break
    return blocks


def sampled(bench: Bench, settings: AcquisitionSettings) -> SimpleNamespace:
    """Acquire so many samples and stop; return the channels, and how many samples were lost."""
    begin(bench, settings)
    blocks = read_samples(bench, settings.n_samples)
    bench.stop()
    joined = {name: np.concatenate([getattr(b, name) for b in blocks]) for name in CHANNELS}
    return SimpleNamespace(lost=lost(blocks), **joined)


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
