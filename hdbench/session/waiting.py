"""Wait for the next samples of a running acquisition, and for no longer than is sound."""

from __future__ import annotations

import time

from hdbench.devices.bench import Bench, Block
from hdbench.errors import DeviceError
from hdbench.session.stop import StopSignals

__all__ = ["next_block"]

_STALL_S = 2.0  # a bench that hands out no sample for this long has stopped sampling


def next_block(bench: Bench, stop: StopSignals) -> Block:
    """Return the next block with samples or losses in it."""
    deadline = time.monotonic() + _STALL_S
    while True:
        stop.check()
        block = bench.read_block()
        if block is not None and block.watchdog_tripped:
            raise DeviceError(
                "the bench controller's watchdog stopped the motor",
                where=f"sample {block.first_index}",
                fix="check load and network of this computer, then run again",
            )
        if block is not None and (len(block) or block.lost_before):
            return block
        if time.monotonic() > deadline:
            raise DeviceError(
                f"no sample for {_STALL_S:g} s while the acquisition should run",
                where="bench controller",
                fix="check that the controller is sampling: hdbench doctor",
            )
        time.sleep(0.002)
