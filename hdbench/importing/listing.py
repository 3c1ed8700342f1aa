"""Content of a foreign file: each channel with its unit, rate, range and share of missing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.importing.layout import MISSING, stamp_seconds
from hdbench.importing.source import Channel, Column, Source
from hdbench.importing.units import unit_scale

# rows that are looked at: enough to see what a channel is, whatever the size of the file; fewer of
# many channels, whose numbers are in memory together
LOOKED_AT, _MOST_NUMBERS, _AT_ONCE = 200_000, 5_000_000, 32
# two's complement: the numbers lie at the two ends of the range, the middle half is empty
_BITS = (8, 16, 32)


@dataclass(frozen=True, slots=True)
class ChannelFacts:
    """What the samples of one channel say, by the first rows of the file."""

    channel: Channel
    number: int  # its number, from 1
    rows: int  # rows looked at
    # one by the median step of the time of its clock, Hz; None without a time
    rate_hz: float | None
    # range and first value; None where there is no number
    least: float | None
    most: float | None
    first: float | None
    missing_share: float  # share of rows without a number
    is_text: bool  # whether it holds words and no number
    bits: int  # bits of a two's complement that seems to be stored without sign; 0 for none
    jump: float  # largest step between neighbours
    whole: bool  # whether all numbers are whole, and not all the same
    # the rows looked at; NaN where there is no number
    numbers: NDArray[np.float64] = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return the facts as ``--json`` prints them."""
        return {
            "name": self.channel.name,
            "number": self.number,
            "unit": self.channel.unit or None,
            "clock": self.channel.clock,
            "rows": self.rows,
            "rate_hz": self.rate_hz,
            "range": None if self.least is None else [self.least, self.most],
            "missing_share": self.missing_share,
        }


def _values(source: Source, raw: NDArray[Any]) -> tuple[NDArray[Any], bool]:
    """Return the numbers of a piece, NaN where there is none, and whether there are words."""
    if raw.dtype != object:
        return raw, False
    values = np.full(len(raw), np.nan)
    words = False
    for k, cell in enumerate(raw):
        word = str(cell).strip()
        if word.lower() in MISSING:
            continue
        try:
            values[k] = float(Decimal(word.replace(",", ".") if source.decimal_comma else word))
        except (InvalidOperation, OverflowError):
            stamp = stamp_seconds(word)
            values[k] = np.nan if stamp is None else float(stamp)
            words |= stamp is None
    return values, words


def read_numbers(
    source: Source, names: Sequence[str], most_rows: int = LOOKED_AT
) -> tuple[dict[str, NDArray[np.float64]], dict[str, bool]]:
    """Read the first values of channels of one clock."""
    columns = {name: Column(None) for name in names}
    words = dict.fromkeys(names, False)
    rows = 0
    source.rounded = frozenset(names)
    for piece in source.read(names):
        for name in names:
            values, found = _values(source, piece[name])
            columns[name].add(values)
            words[name] |= found
        rows += len(next(iter(piece.values())))
        if rows >= most_rows:
            break
    return {name: column.whole() for name, column in columns.items()}, words


def _bits(values: NDArray[np.float64]) -> int:
    if not len(values) or values.min() < 0 or not (values == np.round(values)).all():
        return 0
    for bits in _BITS:
        top = float(1 << bits)
        if values.max() < top:
            high = values[values >= top / 2]
            inside = (values > 0.25 * top) & (values < 0.75 * top)
            return bits if len(high) and not inside.any() else 0
    return 0


def _rate(source: Source, clock: str, values: dict[str, Any], time: str | None) -> float | None:
    channel = next((c for c in source.channels if c.name == time and c.clock == clock), None)
    channel = channel or source.own_time(clock)
    if channel is None or len(values[channel.name]) < 2:
        return None
    scale = unit_scale(channel.unit, "s") or Decimal(1)
    step = float(np.nanmedian(np.diff(values[channel.name]))) * float(scale)
    return 1.0 / step if math.isfinite(step) and step > 0.0 else None


def list_channels(source: Source, time: str | None = None) -> list[ChannelFacts]:
    """Look at every channel of a file."""
    facts: dict[str, ChannelFacts] = {}
    places = {c.name: k for k, c in enumerate(source.channels, 1)}
    most = min(LOOKED_AT, max(1, _MOST_NUMBERS // max(1, len(places))))
    for clock in dict.fromkeys(c.clock for c in source.channels):
        own = [c for c in source.channels if c.clock == clock]
        names = [c.name for c in own]
        values: dict[str, NDArray[np.float64]] = {}
        words: dict[str, bool] = {}
        for first in range(0, len(names), _AT_ONCE):  # some libraries unpack channels whole
            read = read_numbers(source, names[first : first + _AT_ONCE], most)
            values |= read[0]
            words |= read[1]
        rate = _rate(source, clock, values, time)
        for channel in own:
            found = values[channel.name]
            there = found[np.isfinite(found)]
            facts[channel.name] = ChannelFacts(
                channel,
                places[channel.name],
                len(found),
                rate,
                float(there.min()) + 0.0 if len(there) else None,
                float(there.max()) + 0.0 if len(there) else None,
                float(there[0]) if len(there) else None,
                1.0 - len(there) / len(found) if len(found) else 1.0,
                words[channel.name] and not len(there),
                _bits(there),
                float(np.max(np.abs(np.diff(there)))) if len(there) > 1 else 0.0,
                len(there) > 1 and bool((there == np.rint(there)).all() and np.ptp(there)),
                found,
            )
    return [facts[c.name] for c in source.channels]
