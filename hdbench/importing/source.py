"""Source of an import: channels with names, and their values by pieces."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import DataError, HdbenchError, UsageError
from hdbench.importing.units import bare_name

# rows that are in memory at a time: bounds the memory whatever the size of the file
PIECE_ROWS, _PIECE_NUMBERS = 1 << 16, 1 << 22
# a file that claims more is damaged or made to harm; a wide log of a robot has some hundreds
MOST_CHANNELS = 20_000
_LONGEST_UNIT = 40
Piece = Mapping[str, NDArray[Any]]
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel of a file."""

    name: str  # unique in the file; parts are separated by `/`
    unit: str = ""  # as the file states it; empty text where it states none
    clock: str = ""  # channels of one clock have their samples at the same times
    is_time: bool = False  # whether it is the time of its clock
    rows: int | None = None  # number of samples where that is known without reading them


def _asked_for(channels: Sequence[Channel], topic: str | None, joint: str | None) -> list[Channel]:
    """Return the channels of a topic and joint; what is of no joint stays, and every time."""
    if topic is None:
        kept = [*channels]
    else:
        kept = [c for c in channels if f"/{topic.strip('/')}/" in f"/{c.name.strip('/')}"]
    clocks = {c.clock for c in kept}
    if joint is not None:
        around = {a for c in kept for a in _around(c.name, joint)}
        if not around:
            return []
        either = "|".join(f"{re.escape(a)}[^/]+{re.escape(b)}" for a, b in around)
        own = "|".join(re.escape(f"{a}{joint}{b}") for a, b in around)
        dropped = re.compile(f"(?!(?:{own})$)(?:{either})")
        kept = [c for c in kept if not dropped.fullmatch(c.name)]
    names = {c.name for c in kept}
    return [c for c in channels if c.name in names or (c.is_time and c.clock in clocks)]


def _around(name: str, joint: str) -> list[tuple[str, str]]:
    """Return what stands before and behind the joint in a name; nothing where it is not there."""
    word = re.escape(joint)
    match = re.search(rf"(?:^|/){word}/", name) or re.search(rf"[_.\[]{word}\]?$", bare_name(name))
    if match is None:
        return []
    at = name.index(joint, match.start())
    return [(name[:at], name[at + len(joint) :])]


class Source(ABC):
    """A foreign file that is open for reading."""

    row_word = "sample"  # what a row is called in messages

    def __init__(self, path: Path, form: str, close: Callable[[], None] | None = None) -> None:
        self.path = path
        self.form = form
        self._close = close
        self.channels: tuple[Channel, ...] = ()
        self.notes: tuple[str, ...] = ()
        self.decimal_comma = False
        # channels of text whose numbers may come as float64, in place of cells as they stand
        self.rounded: frozenset[str] = frozenset()

    @abstractmethod
    def pieces(self, names: Sequence[str]) -> Iterator[Piece]:
        """Yield the samples of channels of one clock, in pieces of a bounded number of rows.

        Numbers are arrays of float64, int64 or uint64, which the next piece may overwrite; cells
        of text are arrays of str objects.
        """

    def read(self, names: Sequence[str]) -> Iterator[Piece]:
        """Yield the pieces; whatever a library raises on damaged bytes becomes our error."""
        try:
            yield from self.pieces(names)
        except Exception as error:
            raise told(self.path, self.form, error) from error

    def own_time(self, clock: str) -> Channel | None:
        """Return the channel that the file names as the time of a clock."""
        return next((c for c in self.channels if c.is_time and c.clock == clock), None)

    def place(self, row: int) -> str:
        """Return where a person finds a row, counted from 0."""
        return f"{self.path}: {self.row_word} {row + 1}"

    def hold(self, made: Sequence[tuple[Channel, _T]]) -> dict[str, _T]:
        """Take channels, told apart; return what stands behind each, by its name."""
        self.channels = told_apart(self.path, [channel for channel, _ in made])
        return {c.name: behind for c, (_, behind) in zip(self.channels, made, strict=True)}

    def close(self) -> None:
        """Give the file back."""
        if self._close is not None:
            self._close()

    def keep(self, topic: str | None, joint: str | None) -> None:
        """Leave only the channels of a topic and a joint; times stay with their clock.

        A topic is a topic, a sheet, a group or a folder of channels; None means all.
        """
        kept = _asked_for(self.channels, topic, joint)
        if not kept:
            self.close()
            raise UsageError(
                f"no channel of {topic or 'any topic'} and joint {joint or 'any'}",
                where=f"{self.path}, --topic, --joint",
                fix=f"there are: {listed(c.name for c in self.channels)}",
            )
        self.channels = tuple(kept)


class Column:
    """Numbers that come piece by piece, as many as a file says or as many as there are."""

    def __init__(self, rows: int | None) -> None:
        self._values = np.empty(rows or PIECE_ROWS)
        self._count = 0

    def add(self, values: NDArray[Any]) -> None:
        """Put numbers behind those that are there."""
        end = self._count + len(values)
        if end > len(self._values):
            grown = np.empty(2 * end)
            grown[: self._count] = self.whole()
            self._values = grown
        self._values[self._count : end] = values
        self._count = end

    def whole(self) -> NDArray[np.float64]:
        """Return what came so far."""
        return self._values[: self._count]


def piece_rows(numbers: int) -> int:
    """Return how many rows a piece has, by the numbers that each takes in memory."""
    return max(1, min(PIECE_ROWS, _PIECE_NUMBERS // max(1, numbers)))


def spans(rows: int, most: int = PIECE_ROWS) -> Iterator[tuple[int, int]]:
    """Yield where each piece of so many rows begins, and how many rows it has."""
    for start in range(0, rows, most):
        yield start, min(most, rows - start)


def text_cells(cells: Sequence[str]) -> NDArray[Any]:
    """Return cells of text as a column of a piece."""
    column = np.empty(len(cells), dtype=object)
    column[:] = cells
    return column


def listed(names: Iterable[str], most: int = 12) -> str:
    """Return names in one line, the first ones of many."""
    known = list(names)
    return ", ".join(known[:most]) + (", ..." if len(known) > most else "")


def spelled(name: str) -> str:
    r"""Return a name without control characters: they stand as ``\x07``."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in name)


def told_apart(path: Path, channels: Sequence[Channel]) -> tuple[Channel, ...]:
    """Return channels whose names are printable, unique and not too many."""
    if len(channels) > MOST_CHANNELS:
        raise DataError(
            f"{len(channels)} channels; needed: at most {MOST_CHANNELS}",
            where=str(path),
            fix="check that this is the right file",
        )
    clean = [
        replace(c, name=spelled(c.name.strip()), unit=spelled(c.unit.strip())[:_LONGEST_UNIT])
        for c in channels
    ]
    count = Counter(c.name for c in clean)
    taken: Counter[str] = Counter()
    result = []
    for channel in clean:
        taken[channel.name] += 1
        name = channel.name
        if count[name] > 1 or not name:
            name = f"{name}#{taken[channel.name]}"
        result.append(replace(channel, name=name))
    return tuple(result)


@contextmanager
def closed_on_error(close: Callable[[], None]) -> Iterator[None]:
    """Give a file back where it cannot be taken."""
    try:
        yield
    except BaseException:
        close()
        raise


def damaged(path: Path, form: str, error: BaseException | str) -> DataError:
    """Return the error of a file that its reader cannot take."""
    words = " ".join(spelled(str(error).replace("\n", " ")).split())[:200]
    why = words if isinstance(error, str) else f"{type(error).__name__}: {words}"
    return DataError(
        f"damaged {form}: {why}; needed: a whole file",
        where=str(path),
        fix="copy the file again, or write it again with the program that made it",
    )


def told(path: Path, form: str, error: Exception) -> HdbenchError:
    """Return what a reader raised as an error of ours."""
    if isinstance(error, HdbenchError):
        return error
    if isinstance(error, MemoryError):
        error = damaged(path, form, "it asks for more memory than there is")
        return DataError(error.what, where=error.where, fix=f"split it, or {error.fix}")
    if isinstance(error, PermissionError):
        return DataError("cannot read: no right to", where=str(path), fix="ask for the right to it")
    return damaged(path, form, error)


def find_channel(source: Source, name: str) -> Channel | None:
    """Return the channel that `name` means: by name, by its last parts, or by number from 1."""
    channels = source.channels
    exact = [c for c in channels if c.name == name]
    if exact:
        return _plain(source, exact[0])
    twice = [c.name for c in channels if c.name.rpartition("#")[0] == name]
    ends = [c for c in channels if c.name.endswith(f"/{name.strip('/')}")]
    bare = [c for c in channels if name and bare_name(c.name) == name]
    for found in (ends, bare):
        if len(found) == 1:
            return _plain(source, found[0])
    if twice or ends:
        raise DataError(
            f"{name!r:.80} means {len(twice or ends)} channels; needed: one",
            where=str(source.path),
            fix=f"name one of {listed(twice or [c.name for c in ends])}",
        )
    if spelled(name) != name:
        return find_channel(source, spelled(name))
    if name.isascii() and name.isdigit() and 1 <= int(name[:6]) <= len(channels):
        return channels[int(name) - 1]
    return None


def _plain(source: Source, channel: Channel) -> Channel:
    if "\\x" in channel.name or "\\u" in channel.name:
        number = source.channels.index(channel) + 1
        raise DataError(
            f"the name of channel {channel.name!r:.60} holds a control character; needed: text",
            where=str(source.path),
            fix=f"take it by its number: --map NAME={number}",
        )
    return channel


def finite_or_nan(value: object) -> float:
    """Return a number of a record; NaN for anything that is none."""
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return math.nan


def numbers(values: NDArray[Any]) -> NDArray[Any] | None:
    """Return an array as float64, int64 or uint64; None where it holds no numbers."""
    kind = values.dtype.kind
    if kind == "f":
        return np.asarray(values, dtype=np.float64)
    if kind in "bi":
        return np.asarray(values, dtype=np.int64)
    if kind == "u":
        return np.asarray(values, dtype=np.uint64)
    if kind in "mM":  # a date or a duration, exact in ns
        missing = np.isnat(values)
        turned = values.astype("M8[ns]" if kind == "M" else "m8[ns]").astype(np.int64)
        return np.where(missing, np.nan, turned) if missing.any() else np.asarray(turned)
    return None
