"""The registers that set a stream up, start it and stop it."""

from __future__ import annotations

from collections.abc import Callable

from hdbench.drivers.labjack.emulator.memory import Cell, Memory, RefusedError
from hdbench.drivers.labjack.emulator.streaming import StreamEngine, StreamOrder, actual_rate_hz
from hdbench.drivers.labjack.emulator.wiring import Wiring

__all__ = ["StreamRegisters"]

_RATE, _ENTRIES, _PER_PACKET, _SETTLING, _BUFFER, _SCANS = 4002, 4004, 4006, 4008, 4012, 4020
_STOP_WHEN_FULL, _LIST, _ENABLE = 4028, 4100, 4990
_PLAIN = (_ENTRIES, _PER_PACKET, 4010, _BUFFER, 4014, 4016, 4018, _SCANS)
_LONGEST = 128
# what the buffer holds where nothing is asked for
_BUFFER_BYTES = {"T4": 8192, "T7": 4096}
_NOT_RUNNING, _ACTIVE = 2620, 2605
_INPUTS = 14


class StreamRegisters:
    """Adds the stream's cells to a device's map.

    Parameters
    ----------
    memory : Memory
        The device's map.
    engine : StreamEngine
        What is started and stopped.
    wiring : Wiring
        The device's model.
    ticks : callable
        Core timer now.
    """

    def __init__(
        self, memory: Memory, engine: StreamEngine, wiring: Wiring, ticks: Callable[[], int]
    ) -> None:
        self._memory = memory
        self._engine = engine
        self._model = wiring.model
        self._ticks = ticks
        rate = memory.add(_RATE, Cell("f32"))
        rate.on_read = lambda: actual_rate_hz(rate.value) if rate.value > 0.0 else 0.0
        for address in _PLAIN:
            memory.add(address, Cell("u32"))
        memory.add(_SETTLING, Cell("f32"))
        # a T4 has no such register: it always goes on
        self._stop_when_full = Cell("u32")
        if self._model == "T7":
            memory.add(_STOP_WHEN_FULL, self._stop_when_full)
        memory.add(4026, Cell("u32", on_read=lambda: engine.start_ticks % 2**32, writable=False))
        for position in range(_LONGEST):
            memory.add(_LIST + 2 * position, Cell("u32"))
        enable = memory.add(_ENABLE, Cell("u32", on_write=self._switch))
        enable.on_read = lambda: int(engine.running)

    def _switch(self, value: float) -> None:
        if not value:
            if not self._engine.running:
                raise RefusedError(_NOT_RUNNING)
            self._engine.stop()
            return
        if self._engine.running:
            raise RefusedError(_ACTIVE)
        self._engine.start(self._order(), self._ticks())

    def _order(self) -> StreamOrder:
        value = self._memory.value
        entries = min(int(value(_ENTRIES)), _LONGEST)
        rate_hz = float(value(_RATE))
        return StreamOrder(
            rate_hz=actual_rate_hz(rate_hz) if rate_hz > 0.0 else 0.0,
            addresses=tuple(int(value(_LIST + 2 * n)) for n in range(entries)),
            samples_per_packet=int(value(_PER_PACKET)),
            buffer_samples=(int(value(_BUFFER)) or _BUFFER_BYTES[self._model]) // 2,
            n_scans=int(value(_SCANS)),
            stop_when_full=bool(self._stop_when_full.value),
            ranges_v={number: self._range_v(number) for number in range(_INPUTS)},
        )

    def _range_v(self, number: int) -> float:
        # ranges travel as 32-bit floats; 0 is the widest
        value = float(self._memory.value(40000 + 2 * number)) or 10.0
        return min((10.0, 1.0, 0.1, 0.01), key=lambda known: abs(known - value))
