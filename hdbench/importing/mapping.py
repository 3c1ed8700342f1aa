"""Mapping of an import: ``--map`` and ``--set`` as data."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal

from hdbench.errors import DataError, HdbenchError, UsageError
from hdbench.importing.source import Channel, Source, find_channel, listed
from hdbench.importing.units import known_unit

# what may be declared behind a channel beside its unit
WORDS = ("int8", "int16", "int32", "wrapped", "output", "motor", "zero")

_EXAMPLES = {"--map": "torque_nm=Torque*0.001", "--set": "2:series=down"}
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_LINEAR = re.compile(
    rf"(?P<name>.+?)(?:(?P<sign>[*/])(?P<scale>-?{_NUMBER}))?(?P<offset>[+-]{_NUMBER})?"
)
_TARGET = re.compile(r"(?:(?P<file>[1-9]\d{0,3}):)?(?P<target>[a-z][a-z0-9_]*)=(?P<rest>.+)")


@dataclass(frozen=True, slots=True)
class Entry:
    """One ``--map`` or ``--set``: where a column comes from, or the value in every row.

    Parameters
    ----------
    target : str
        Column name of the contract.
    text : str
        The value, or ``COLUMN``, ``COLUMN*SCALE``, ``COLUMN/SCALE``, each with ``+OFFSET`` or
        ``-OFFSET``, and declared conversions behind it: ``COLUMN@deg@wrapped``.
    file : int or None
        Number of the file, from 1, that it is about; None for all.
    """

    target: str
    text: str
    file: int | None = None


@dataclass(frozen=True, slots=True)
class SourceColumn:
    """A channel of a foreign file and what turns its numbers into ours.

    Parameters
    ----------
    channel : Channel
        The channel.
    scale, offset : Decimal
        value = number * scale + offset.
    plain : bool
        Whether neither scale nor offset was given; a scale of 1 that was given is one.
    words : tuple of str
        Declared conversions, in the order of the text.
    """

    channel: Channel
    scale: Decimal = Decimal(1)
    offset: Decimal = Decimal(0)
    plain: bool = True
    words: tuple[str, ...] = ()


def parse_entry(option: str, text: str, known: Sequence[str]) -> Entry:
    """Parse ``[FILE_NUMBER:]NAME=...`` of ``--map`` or ``--set``."""
    match = _TARGET.fullmatch(text)
    if match is None:
        raise UsageError(
            f"found {text!r:.80}; needed: [FILE_NUMBER:]NAME=...",
            where=option,
            fix=f"such as {option} {_EXAMPLES[option]}",
        )
    target = match["target"]
    near = difflib.get_close_matches(target, known, n=1, cutoff=0.75)
    if target not in known and near:
        raise UsageError(f"no column {target!r}", where=option, fix=f"did you mean {near[0]!r}?")
    return Entry(target, match["rest"], int(match["file"]) if match["file"] else None)


def find_source(source: Source, text: str, option: str) -> SourceColumn:
    """Return the channel that `text` means; a channel's own name goes before arithmetic."""
    exact = find_channel(source, text)
    if exact is not None:
        return SourceColumn(exact)
    rest, *words = text.split("@")
    column = _linear(source, rest, option) if words else None
    if column is None:
        column = _linear(source, text, option)
        words = [] if column is not None else words
    if column is None:
        raise _no_channel(source, rest, option)
    for word in words:
        if word not in WORDS and not known_unit(word):
            raise UsageError(
                f"{word!r:.40} behind {rest!r:.60} is neither a unit nor a conversion",
                where=option,
                fix=f"give a unit such as deg, rpm, ms, mV, or one of {', '.join(WORDS)}",
            )
    return replace(column, words=tuple(words))


def _linear(source: Source, text: str, option: str) -> SourceColumn | None:
    exact = find_channel(source, text)
    if exact is not None:
        return SourceColumn(exact)
    match = _LINEAR.fullmatch(text)
    channel = None if match is None else find_channel(source, match["name"])
    if match is None or channel is None:
        return None
    scale = Decimal(match["scale"] or 1)
    if scale == 0:
        raise UsageError(f"scale 0 in {text!r:.80}", where=option, fix="give another scale")
    if match["sign"] == "/":
        scale = 1 / scale
    return SourceColumn(channel, scale, Decimal(match["offset"] or 0), plain=False)


def _no_channel(source: Source, text: str, option: str) -> HdbenchError:
    if any(note.startswith(f"{text} = ") for note in source.notes):
        return DataError(
            f"{text!r:.80} is a single number, 1 row; needed: at least 2",
            where=str(source.path),
            fix="record again, or check that this is the right file",
        )
    names = [channel.name for channel in source.channels]
    near = difflib.get_close_matches(text, names, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return UsageError(
        f"no column {text!r:.80} in {source.path}",
        where=option,
        fix=f"{hint}columns: {listed(names)}",
    )
