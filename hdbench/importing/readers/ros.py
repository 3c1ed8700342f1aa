"""ROS 1 bags, ROS 2 bags (SQLite, MCAP, with or without metadata.yaml), by rosbags.

Topics have clocks of their own: the stamp in the header where there is one, else the time at which
the message was recorded. In messages that name joints (JointState and the like), each joint is a
channel of its own.
"""

from __future__ import annotations

import importlib
import itertools
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hdbench.importing import source

_FORM = "ROS bag"
_NAMES = ("name", "names", "joint_names")
_STAMP = ("header/stamp/sec", "header/stamp/nanosec")
# units as the definitions of the messages state them (REP 103: SI)
_UNITS = {
    "sensor_msgs/msg/JointState": {"position": "rad", "velocity": "rad/s", "effort": "N m"},
    "sensor_msgs/msg/Temperature": {"temperature": "degC"},
}
_MOST_ELEMENTS = 512
_SIZED = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
_DTYPES = {name: np.dtype(name) for name in (*_SIZED, "float32", "float64")}
_DTYPES |= dict.fromkeys(("bool", "byte", "char", "octet"), np.dtype("uint8"))
_BASE, _NAME, _ARRAY = 1, 2, 3
_DEEPEST = 16
# messages in a list within a message that are taken apart
_MOST_INNER = 64
# layouts of one length that are remembered: publishers that take turns on one topic
_MOST_LAYOUTS = 8


@dataclass(frozen=True, slots=True)
class _Place:
    """Numbers in a message: where they begin, their type, and how many; None for a single one."""

    at: int
    dtype: np.dtype[Any]
    count: int | None


class RosMessage:
    """Layout of one message, taken apart by the definition of its type.

    Both wire forms are read: CDR of ROS 2 (aligned, either byte order) and that of ROS 1 (packed,
    little-endian). The definition may come from the file, so nothing of it is ever executed.
    """

    def __init__(self, types: Mapping[str, Any], data: bytes, name: str, *, ros2: bool) -> None:
        self._types = types
        self._order: Literal["<", ">"] = "<"
        self._data = data
        self._align = ros2
        self._at = 0
        # numbers and texts by their paths
        self.places: dict[str, _Place] = {}
        self.texts: dict[str, list[str]] = {}
        # lengths and names: a message with the same has its numbers at the same places
        self._fixed: list[tuple[int, bytes]] = []
        if ros2:
            if len(data) < 4 or data[0] != 0 or data[1] > 1:
                raise ValueError("a message that is not plain CDR")
            self._order = "<" if data[1] else ">"
            self._fixed.append((0, data[:4]))
            self._at = 4
        self._message(name, "", 0, kept=True)

    def fits(self, data: bytes) -> bool:
        """Return whether another message has its numbers at the same places."""
        return len(data) == len(self._data) and all(
            data.startswith(known, at) for at, known in self._fixed
        )

    def numbers(self, path: str, rows: NDArray[np.uint8]) -> NDArray[Any] | None:
        """Return the numbers of a field of messages that fit, a row for each message."""
        place = self.places.get(path)
        if place is None:
            return None
        size = place.dtype.itemsize * (1 if place.count is None else place.count)
        part = np.ascontiguousarray(rows[:, place.at : place.at + size])
        return part.view(place.dtype) if size else None

    def _message(self, name: str, before: str, depth: int, *, kept: bool) -> None:
        if depth > _DEEPEST:
            raise ValueError("messages nested too deeply")
        for field, description in self._types[name][1]:
            self._field(description, f"{before}{field}", depth, kept=kept)

    def _field(self, description: Any, path: str, depth: int, *, kept: bool) -> None:
        kind, what = int(description[0]), description[1]
        if kind == _NAME:
            self._message(what, f"{path}/", depth + 1, kept=kept)
        elif kind == _BASE and what[0] in _DTYPES:
            self._numbers(what[0], None, path, kept=kept)
        elif kind == _BASE:
            self._text(what[0], path, kept=kept)
        else:
            inner, length = what
            count = length if kind == _ARRAY else self._length()
            # each element takes a byte at least
            if count > len(self._data) - self._at:
                raise ValueError(f"{path} claims {count} elements")
            if int(inner[0]) == _BASE and inner[1][0] in _DTYPES:
                self._numbers(inner[1][0], count, path, kept=kept)
                return
            alone = int(inner[0]) != _BASE
            for k in range(count):
                at = f"{path}[{k}]" if alone else path
                self._field(inner, at, depth, kept=kept and (k < _MOST_INNER or not alone))

    def _numbers(self, name: str, count: int | None, path: str, *, kept: bool) -> None:
        dtype = _DTYPES[name].newbyteorder(self._order)
        if count != 0:
            self._pad(dtype.itemsize)
        place = _Place(self._at, dtype, count)
        self._take(dtype.itemsize * (1 if count is None else count))
        if kept:
            self.places[path] = place

    def _text(self, name: str, path: str, *, kept: bool) -> None:
        if name != "string":
            raise ValueError(f"a field of type {name!r:.40}")
        raw = self._take(self._length())
        if kept:
            word = (raw[:-1] if self._align else raw).decode("utf-8", "replace")
            self.texts.setdefault(path, []).append(word)
        if path.rpartition("/")[2] in _NAMES:
            self._fixed.append((self._at - len(raw), raw))

    def _length(self) -> int:
        self._pad(4)
        at, raw = self._at, self._take(4)
        self._fixed.append((at, raw))
        return int.from_bytes(raw, "little" if self._order == "<" else "big")

    def _pad(self, size: int) -> None:
        if self._align:  # counted from behind the four bytes that say the byte order
            self._at += -(self._at - 4) % size

    def _take(self, size: int) -> bytes:
        data = self._data[self._at : self._at + size]
        if len(data) != size:
            raise ValueError(f"a message ends {size - len(data)} bytes short")
        self._at += size
        return data


@dataclass(frozen=True, slots=True)
class _Getter:
    """Which number of a message a channel is."""

    path: str
    index: int = 0
    joints: str = ""
    joint: str = ""

    def values(self, layout: RosMessage, rows: NDArray[np.uint8]) -> NDArray[Any] | None:
        """Return the numbers of messages of one layout; None where it has none."""
        if self.path == "stamp":
            seconds, rest = (layout.numbers(path, rows) for path in _STAMP)
            if seconds is None or rest is None:
                return None
            return np.asarray(seconds[:, 0].astype(np.int64) * 10**9 + rest[:, 0])
        index = self.index
        if self.joints:
            names = layout.texts.get(self.joints, [])
            index = names.index(self.joint) if self.joint in names else -1
        found = layout.numbers(self.path, rows)
        return found[:, index] if found is not None and 0 <= index < found.shape[1] else None


class _RosSource(source.Source):
    row_word = "message"

    def __init__(self, path: Path, reader: Any, close: Callable[[], None]) -> None:
        super().__init__(path, _FORM, close)
        self._reader = reader
        self._ros2 = not hasattr(reader, "chunks")
        typesys = importlib.import_module("rosbags.typesys")
        stores = typesys.Stores
        known = stores.LATEST if self._ros2 else stores.ROS1_NOETIC
        self._types: dict[str, Any] = dict(typesys.get_typestore(known).fielddefs)
        notes: list[str] = []
        made: list[tuple[source.Channel, _Getter]] = []
        self._topics: dict[str, Any] = {}
        for connection in reader.connections:
            self._learn(typesys, connection)
            topic = connection.topic
            if topic in self._topics:
                continue
            if connection.msgtype not in self._types:
                notes.append(
                    f"topic {source.spelled(topic)}: no definition of {connection.msgtype!r:.80}"
                )
                continue
            self._topics[topic] = connection
            made += self._channels(connection)
        self._getters = self.hold(made)
        self.notes = tuple(notes)

    def _learn(self, typesys: Any, connection: Any) -> None:
        """Take the definition of a type from the bag: parsed, never executed."""
        text = connection.msgdef.data
        form = connection.msgdef.format.name
        if form == "MSG":
            self._types.update(typesys.get_types_from_msg(text, connection.msgtype))
        elif form == "IDL":
            line = "=" * 80 + "\n"
            parts = text.split(line)[1:] if text.startswith(line) else [text]
            for part in parts:
                body = part.split("\n", 1)[1] if part.startswith("IDL: ") else part
                self._types.update(typesys.get_types_from_idl(body))

    def _messages(self, connection: Any) -> Iterator[tuple[int, str, bytes]]:
        same = [c for c in self._reader.connections if c.topic == connection.topic]
        for found, received, raw in self._reader.messages(connections=same):
            yield received, found.msgtype, bytes(raw)

    def _layout(self, kind: str, raw: bytes) -> RosMessage:
        return RosMessage(self._types, raw, kind, ros2=self._ros2)

    def _channels(self, connection: Any) -> list[tuple[source.Channel, _Getter]]:
        topic = connection.topic
        first = next(self._messages(connection), None)
        if first is None:
            return []
        _, kind, raw = first
        layout = self._layout(kind, raw)
        stamp = _Getter("stamp").values(layout, _matrix([raw]))
        times = ("received",) if stamp is None or not stamp[0] else ("stamp", "received")
        rows = connection.msgcount
        made = [
            (source.Channel(f"{topic}/{name}", "ns", topic, name == times[0], rows), _Getter(name))
            for name in times
        ]
        units = _UNITS.get(connection.msgtype, {})
        for path, place in layout.places.items():
            if path.startswith("header/"):
                continue
            for name, getter in _elements(path, place, layout):
                unit = units.get(path, "")
                made.append((source.Channel(f"{topic}/{name}", unit, topic, False, rows), getter))
        return made

    def pieces(self, names: Sequence[str]) -> Iterator[source.Piece]:
        clocks = {c.name: c.clock for c in self.channels}
        getters = {name: self._getters[name] for name in names}
        messages = self._messages(self._topics[clocks[names[0]]])
        for first in messages:
            # others of a topic are about as long
            rest = itertools.islice(messages, source.piece_rows(len(first[2]) // 4) - 1)
            yield self._piece([first, *rest], getters)

    def _piece(
        self, messages: Sequence[tuple[int, str, bytes]], getters: Mapping[str, _Getter]
    ) -> source.Piece:
        piece: dict[str, NDArray[Any]] = {}
        for name, getter in getters.items():
            # times are whole numbers of ns
            nothing = np.int64(0) if getter.path in ("stamp", "received") else np.nan
            piece[name] = np.full(len(messages), nothing)
        for layout, places, data in self._alike(messages):
            rows = _matrix(data)
            for name, getter in getters.items():
                if getter.path == "received":
                    piece[name][places] = [messages[k][0] for k in places]
                    continue
                values = getter.values(layout, rows)
                if values is not None:
                    piece[name][places] = values
        return piece

    def _alike(
        self, messages: Sequence[tuple[int, str, bytes]]
    ) -> Iterator[tuple[RosMessage, list[int], list[bytes]]]:
        """Yield messages of one layout, with their places."""
        known: dict[tuple[str, int], list[tuple[RosMessage, list[int], list[bytes]]]] = {}
        for k, (_, kind, raw) in enumerate(messages):
            groups = known.setdefault((kind, len(raw)), [])
            group = next((g for g in groups if g[0].fits(raw)), None)
            if group is None:
                group = (self._layout(kind, raw), [], [])
                groups.append(group)
                if len(groups) > _MOST_LAYOUTS:
                    yield groups.pop(0)
            group[1].append(k)
            group[2].append(raw)
        for groups in known.values():
            yield from groups


def _matrix(messages: Sequence[bytes]) -> NDArray[np.uint8]:
    """Return messages of one length as the rows of a matrix."""
    return np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), -1)


def _elements(path: str, place: _Place, layout: RosMessage) -> list[tuple[str, _Getter]]:
    """Return the channels that a field is: one number, one for each joint, or one per element."""
    if place.count is None:
        return [(path, _Getter(path))]
    if not 0 < place.count <= _MOST_ELEMENTS:
        return []
    parent, _, field = path.rpartition("/")
    for key in _NAMES:
        at = f"{parent}/{key}" if parent else key
        joints = layout.texts.get(at, [])
        if len(joints) == place.count:
            before = f"{parent}/" if parent else ""
            return [(f"{before}{j}/{field}", _Getter(path, 0, at, j)) for j in joints]
    return [(f"{path}[{k}]", _Getter(path, k)) for k in range(place.count)]


def open_file(path: Path) -> source.Source:
    """Open a bag."""
    held = ExitStack()
    with source.closed_on_error(held.close):
        reader = _reader(path, Path(held.enter_context(tempfile.TemporaryDirectory())))
        reader.open()
        held.callback(reader.close)
        return _RosSource(path, reader, held.close)


def _reader(path: Path, keeper: Path) -> Any:
    if path.is_dir():
        return importlib.import_module("rosbags.rosbag2").Reader(path)
    with path.open("rb") as file:
        head = file.read(16)
    if head.startswith(b"#ROSBAG"):
        return importlib.import_module("rosbags.rosbag1").Reader(path)
    if head.startswith(b"SQLite"):
        _check_sqlite(path)
    # the library goes by the ending, and takes the name of a database for a part of an address
    link = keeper / ("bag.db3" if head.startswith(b"SQLite") else "bag.mcap")
    link.symlink_to(path.resolve())
    return importlib.import_module("rosbags.rosbag2").Reader(link)


def _check_sqlite(path: Path) -> None:
    """Refuse a database that was cut: its header says how long it is."""
    with path.open("rb") as file:
        header = file.read(100)
    if len(header) < 100:
        raise source.damaged(path, _FORM, f"{len(header)} bytes, less than a database has")
    page = int.from_bytes(header[16:18], "big")
    page = 65536 if page == 1 else page
    pages = int.from_bytes(header[28:32], "big")
    size = path.stat().st_size
    if pages and page * pages > size:
        raise source.damaged(path, _FORM, f"{size} bytes of {page * pages}, as its header says")
