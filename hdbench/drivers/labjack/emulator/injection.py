"""Faults inside the emulated device, ordered over its own wire.

A campaign that runs the emulator in another process writes an argument to USER_RAM21_U32 (46142)
and then a code to USER_RAM20_U32 (46140); a real device ignores both.

| code | fault | argument |
|---|---|---|
| 1 | the network is away: packets stay in the device's buffer | ms |
| 2 | scans vanish without a word (an index jump) | scans |
| 3 | the stream ends | status, 2942 to 2945 |
| 4 | a gateway swaps the words of 32-bit values | 1 on, 0 off |
| 5, 6, 7, 8 | torque, tacho, current, reference input | 0 mended, 1 stuck, 2 high, 3 low |
| 9 | the device restarts | - |
"""

from __future__ import annotations

from collections.abc import Callable

from hdbench.devices.emulator.instrument import ChannelFault, Input
from hdbench.drivers.labjack.emulator.memory import Cell, Memory, RefusedError

__all__ = ["ARGUMENT", "CODE", "FaultActs", "Injection"]

CODE, ARGUMENT = 46140, 46142
_CHANNELS: tuple[Input, ...] = ("torque", "tacho", "current", "reference")
_FAULTS: tuple[ChannelFault | None, ...] = (None, "stuck", "high", "low")
_ILLEGAL_VALUE = 3

FaultActs = dict[int, Callable[[int], None]]


class Injection:
    """Adds the two cells to a device's map.

    Parameters
    ----------
    memory : Memory
        The device's map.
    acts : dict of int to callable
        What the codes 1, 2, 3, 4 and 9 do with their argument.
    disturb : callable
        ``disturb(channel, fault)`` breaks or mends an input.
    """

    def __init__(
        self,
        memory: Memory,
        acts: FaultActs,
        disturb: Callable[[Input, ChannelFault | None], None],
    ) -> None:
        self._memory = memory
        self._acts = acts
        self._disturb = disturb
        memory.add(ARGUMENT, Cell("u32"))
        memory.add(CODE, Cell("u32", on_write=self._order))

    def _order(self, value: float) -> None:
        code, argument = int(value), int(self._memory.value(ARGUMENT))
        channel = code - 5
        if code in self._acts:
            self._acts[code](argument)
        elif 0 <= channel < len(_CHANNELS) and argument < len(_FAULTS):
            self._disturb(_CHANNELS[channel], _FAULTS[argument])
        elif code:
            raise RefusedError(_ILLEGAL_VALUE, _ILLEGAL_VALUE)
