"""ROS 1 bags, ROS 2 bags (SQLite, MCAP, with or without metadata.yaml), by rosbags.

Topics have clocks of their own: the stamp in the header where there is one, else the time at which
the message was recorded. In messages that name joints (JointState and the like), each joint is a
channel of its own.
"""

from __future__ import annotations

import importlib
import struct
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.errors import DataError
from hdbench.importing.source import (
    PIECE_ROWS,
    Channel,
    Piece,
    Source,
    finite_or_nan,
    spelled,
)

_FORM = "ROS bag"
_NAMES = ("name", "names", "joint_names")
_STAMP = ("header/stamp/sec", "header/stamp/nanosec")
# units as the definitions of the messages state them (REP 103: SI)
_UNITS = {
    "sensor_msgs/msg/JointState": {"position": "rad", "velocity": "rad/s", "effort": "N m"},
    "sensor_msgs/msg/Temperature": {"temperature": "degC"},
}
_MOST_ELEMENTS = 512
_SIZES = {
    "bool": ("B", 1),
    "byte": ("B", 1),
    "char": ("B", 1),
    "octet": ("B", 1),
    "int8": ("b", 1),
    "uint8": ("B", 1),
    "int16": ("h", 2),
    "uint16": ("H", 2),
    "int32": ("i", 4),
    "uint32": ("I", 4),
    "int64": ("q", 8),
    "uint64": ("Q", 8),
    "float32": ("f", 4),
    "float64": ("d", 8),
}
_BASE, _NAME, _ARRAY = 1, 2, 3
_DEEPEST = 16
# messages in a list within a message that are taken apart
_MOST_INNER = 64


class RosMessage:
    """One message, taken apart by the definition of its type.

    Both wire forms are read: CDR of ROS 2 (aligned, either byte order) and that of ROS 1 (packed,
    little-endian). The definition may come from the file, so nothing of it is ever executed.

    Parameters
    ----------
    types : mapping
        Definitions by name: constants, and pairs of name and description of each field.
    data : bytes
        The message.
    ros2 : bool
        Whether it is CDR.
    """

    def __init__(self, types: Mapping[str, Any], data: bytes, *, ros2: bool) -> None:
        self._types = types
        self._order = "<"
        self._data = data
        self._ros2 = ros2
        if ros2:
            if len(data) < 4 or data[0] != 0 or data[1] > 1:
                raise ValueError("a message that is not plain CDR")
            self._order = "<" if data[1] else ">"
            self._data = data[4:]
        self._at = 0

    def fields(self, name: str) -> dict[str, Any]:
        """Return the values of a message of a type by their paths: numbers, arrays, text."""
        found: dict[str, Any] = {}
        self._message(name, "", found, 0)
        return found

    def _message(self, name: str, before: str, found: dict[str, Any], depth: int) -> None:
        if depth > _DEEPEST:
            raise ValueError("messages nested too deeply")
        for field, description in self._types[name][1]:
            self._field(description, f"{before}{field}", found, depth)

    def _field(self, description: Any, path: str, found: dict[str, Any], depth: int) -> None:
        kind, what = int(description[0]), description[1]
        if kind == _BASE:
            found[path] = self._base(what[0])
        elif kind == _NAME:
            self._message(what, f"{path}/", found, depth + 1)
        else:
            inner, length = what
            count = length if kind == _ARRAY else self._number("I", 4)
            self._list(inner, count, path, found, depth)

    def _list(self, inner: Any, count: int, path: str, found: dict[str, Any], depth: int) -> None:
        # each element takes a byte at least
        if count > len(self._data) - self._at:
            raise ValueError(f"{path} claims {count} elements")
        if int(inner[0]) == _BASE and inner[1][0] in _SIZES:
            code, size = _SIZES[inner[1][0]]
            if count:
                self._align(size)
            values = np.frombuffer(self._take(count * size), dtype=f"{self._order}{code}")
            found[path] = values
        elif int(inner[0]) == _BASE:
            found[path] = [self._base(inner[1][0]) for _ in range(count)]
        else:
            for k in range(count):
                kept = found if k < _MOST_INNER else {}
                self._field(inner, f"{path}[{k}]", kept, depth)

    def _base(self, name: str) -> Any:
        if name in _SIZES:
            return self._number(*_SIZES[name])
        if name != "string":
            raise ValueError(f"a field of type {name!r:.40}")
        raw = self._take(self._number("I", 4))
        return (raw[:-1] if self._ros2 else raw).decode("utf-8", "replace")

    def _number(self, code: str, size: int) -> Any:
        self._align(size)
        return struct.unpack(f"{self._order}{code}", self._take(size))[0]

    def _align(self, size: int) -> None:
        if self._ros2:
            self._at += -self._at % size

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
    index: int | None = None
    joints: str = ""
    joint: str = ""

    def value(self, fields: Mapping[str, Any]) -> float:
        found = fields.get(self.path)
        index = self.index
        if self.joints:
            names = fields.get(self.joints, [])
            index = names.index(self.joint) if self.joint in names else -1
        if index is not None:
            if not 0 <= index < len(found if found is not None else ()):
                return np.nan
            found = found[index] if found is not None else None
        return finite_or_nan(found)


class _RosSource(Source):
    def __init__(self, path: Path, reader: Any, close: Callable[[], None]) -> None:
        super().__init__(path, _FORM)
        self._reader, self._close = reader, close
        self._ros2 = not hasattr(reader, "chunks")
        typesys = importlib.import_module("rosbags.typesys")
        stores = typesys.Stores
        known = stores.LATEST if self._ros2 else stores.ROS1_NOETIC
        self._types: dict[str, Any] = dict(typesys.get_typestore(known).fielddefs)
        notes: list[str] = []
        made: list[tuple[Channel, _Getter]] = []
        self._topics: dict[str, Any] = {}
        for connection in reader.connections:
            self._learn(typesys, connection)
            topic = connection.topic
            if topic in self._topics:
                continue
            if connection.msgtype not in self._types:
                notes.append(f"topic {spelled(topic)}: no definition of {connection.msgtype!r:.80}")
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

    def _messages(self, connection: Any) -> Iterator[tuple[int, dict[str, Any]]]:
        same = [c for c in self._reader.connections if c.topic == connection.topic]
        for found, received, raw in self._reader.messages(connections=same):
            message = RosMessage(self._types, bytes(raw), ros2=self._ros2)
            fields = message.fields(found.msgtype)
            fields["received"] = received
            if _STAMP[0] in fields:
                fields["stamp"] = fields[_STAMP[0]] * 10**9 + fields[_STAMP[1]]
            yield received, fields

    def _channels(self, connection: Any) -> list[tuple[Channel, _Getter]]:
        topic = connection.topic
        first = next(self._messages(connection), None)
        if first is None:
            return []
        fields = first[1]
        stamped = bool(fields.get("stamp"))
        times = ("stamp", "received") if stamped else ("received",)
        rows = connection.msgcount
        made = [
            (Channel(f"{topic}/{name}", "ns", topic, name == times[0], rows), _Getter(name))
            for name in times
        ]
        units = _UNITS.get(connection.msgtype, {})
        for path, value in fields.items():
            if path in (*times, "received", "stamp") or path.startswith("header/"):
                continue
            for name, getter in _elements(path, value, fields):
                unit = units.get(path, "")
                made.append((Channel(f"{topic}/{name}", unit, topic, False, rows), getter))
        return made

    def pieces(self, names: Sequence[str]) -> Iterator[Piece]:
        clocks = {c.name: c.clock for c in self.channels}
        getters = {name: self._getters[name] for name in names}
        times = [name for name, getter in getters.items() if getter.path in ("stamp", "received")]
        rows: dict[str, list[Any]] = {name: [] for name in names}
        count = 0
        for _, fields in self._messages(self._topics[clocks[names[0]]]):
            for name, getter in getters.items():
                value = fields.get(getter.path) if name in times else getter.value(fields)
                rows[name].append(value)
            count += 1
            if count % PIECE_ROWS == 0:
                yield _piece(rows, times)
                rows = {name: [] for name in names}
        if count % PIECE_ROWS:
            yield _piece(rows, times)

    def place(self, row: int) -> str:
        return f"{self.path}: message {row + 1}"

    def close(self) -> None:
        self._close()


def _piece(rows: Mapping[str, list[Any]], times: Sequence[str]) -> Piece:
    return {
        name: np.array(values, dtype=np.int64 if name in times else np.float64)
        for name, values in rows.items()
    }


def _elements(path: str, value: Any, fields: Mapping[str, Any]) -> list[tuple[str, _Getter]]:
    """Return the channels that a field is: one number, one for each joint, or one per element."""
    if isinstance(value, int | float):
        return [(path, _Getter(path))]
    if not isinstance(value, np.ndarray) or not 0 < len(value) <= _MOST_ELEMENTS:
        return []
    parent, _, field = path.rpartition("/")
    for key in _NAMES:
        at = f"{parent}/{key}" if parent else key
        joints = fields.get(at)
        if isinstance(joints, list) and len(joints) == len(value):
            before = f"{parent}/" if parent else ""
            return [(f"{before}{j}/{field}", _Getter(path, None, at, j)) for j in joints]
    return [(f"{path}[{k}]", _Getter(path, k)) for k in range(len(value))]


def open_file(path: Path) -> Source:
    """Open a bag."""
    keeper = tempfile.TemporaryDirectory()
    try:
        reader = _reader(path, Path(keeper.name))
        reader.open()
    except BaseException:
        keeper.cleanup()
        raise

    def close() -> None:
        reader.close()
        keeper.cleanup()

    try:
        return _RosSource(path, reader, close)
    except BaseException:
        close()
        raise


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
        raise DataError(
            f"{len(header)} bytes; needed: a database", where=str(path), fix="copy the file again"
        )
    page = int.from_bytes(header[16:18], "big")
    page = 65536 if page == 1 else page
    pages = int.from_bytes(header[28:32], "big")
    size = path.stat().st_size
    if pages and page * pages > size:
        raise DataError(
            f"damaged ROS bag: {size} bytes; needed: {page * pages}, as its header says",
            where=str(path),
            fix="copy the file again",
        )
