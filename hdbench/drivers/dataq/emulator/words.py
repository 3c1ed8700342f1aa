"""What stands in the words of a scan."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.emulator.instrument import ElectricalSamples, Input
from hdbench.drivers.dataq.models import Model
from hdbench.records.trace import FloatArray

__all__ = ["Terminal", "scan_words"]

Terminal = tuple[Input, float]
"""What is wired to an analog input, and how many volts of it stand there per volt."""

# D6 to D0 open are pulled up; D1 and D0 come inverted in the lower byte
OPEN_LINES = 0x7F
_FULL = 32768
_ANALOG, _DIGITAL, _COUNTER = range(8), 8, 10


def scan_words(
    samples: ElectricalSamples,
    entries: tuple[int, ...],
    model: Model,
    wiring: Mapping[int, Terminal],
    lines: int = OPEN_LINES,
    edges: NDArray[np.int64] | None = None,
) -> NDArray[np.int16]:
    """Return the scans of a list as they stand in the stream."""
    ranges = {code: range_v for range_v, code in model.ranges.items()}
    columns = []
    for entry in entries:
        kind = entry & 0xF
        if kind in _ANALOG:
            name, factor = wiring.get(kind, ("torque", 0.0))
            volts = samples.volts[name] * factor
            columns.append(_analog(volts, ranges.get(entry >> 8, 10.0), model.bits))
        elif kind == _COUNTER and edges is not None:
            columns.append((edges % 65536 - _FULL).astype(np.int16))
        else:
            constant = lines << 8 | ~lines & 3 if kind == _DIGITAL else -_FULL & 0xFFFF
            columns.append(np.full(len(samples), constant, dtype=np.uint16).astype(np.int16))
    words = np.column_stack(columns).astype(np.int16)
    if not model.digital:
        words[:, 0] |= lines & 3
    return words


def _analog(volts: FloatArray, range_v: float, bits: int) -> NDArray[np.int16]:
    step = 1 << (16 - bits)
    counts = np.rint(volts * (_FULL / (range_v * step))) * step
    words: NDArray[np.int16] = np.clip(counts, -_FULL, _FULL - step).astype(np.int16)
    return words
