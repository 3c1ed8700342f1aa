"""An emulated device in a thread of this process, and what a driver reads of it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from hdbench.devices.daq import Daq, ScanBlock


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
