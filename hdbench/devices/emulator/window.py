"""The block window: one block stays, unchanged, until it is acknowledged."""

from __future__ import annotations

from hdbench.devices.emulator.machine import NodeMachine
from hdbench.devices.node.blockcodec import BlockHeader, encode_block, seal_block
from hdbench.devices.node.registers import State

__all__ = ["BlockWindow"]


class BlockWindow:
    """Forms blocks from the sample buffer of `machine`.

    Parameters
    ----------
    machine : NodeMachine
        The node's acquisition.
    """

    def __init__(self, machine: NodeMachine) -> None:
        self._machine = machine
        self._block: bytes | None = None
        self._seq = 0
        self.scans = 0

    def clear(self) -> None:
        """Forget the block and number the next one 1."""
        self._block = None
        self._seq = 0
        self.scans = 0

    def acknowledge(self, seq: int) -> None:
        """Let go of the block if `seq` is its number; any other number changes nothing."""
        if self._block is not None and seq == self._seq:
            self._block = None
            self.scans = 0

    def image(self, echo: int) -> bytes:
        """Return the block that waits for its acknowledgement, or form the next one."""
        if self._block is None:
            self._block = self._next()
        if self._block is not None:
            return seal_block(self._block, echo)
        return seal_block(encode_block(self._header(0, 0, self._machine.fifo.next_out), b""), echo)

    def _header(self, seq: int, depth: int, first_index: int) -> BlockHeader:
        machine = self._machine
        return BlockHeader(
            machine.starts, seq, machine.flags(), depth, first_index, machine.channels
        )

    def _next(self) -> bytes | None:
        machine = self._machine
        if machine.fifo.depth < machine.block_scans:
            machine.produce_ahead()
        ended = machine.state != State.RUNNING
        lost_at_the_end = ended and machine.fifo.next_out < machine.fifo.taken
        if not (machine.block_is_due() and (machine.fifo.depth or lost_at_the_end)):
            return None
        first_index, scans = machine.fifo.take(machine.block_scans)
        self._seq = self._seq % 0xFFFF + 1
        self.scans = machine.fifo.next_out - first_index
        # losses that no later scan will show count as one more to come
        untold = ended and machine.fifo.next_out < machine.fifo.taken
        depth = max(machine.fifo.depth, int(untold))
        return encode_block(self._header(self._seq, min(depth, 0xFFFF), first_index), scans)
