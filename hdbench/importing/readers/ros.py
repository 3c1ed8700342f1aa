"""ROS 1 bags, ROS 2 bags (SQLite, MCAP, with or without metadata.yaml), by rosbags.

Topics have clocks of their own: the stamp in the header where there is one, else the time at which
the message was recorded. In messages that name joints (JointState and the like), each joint is a
channel of its own.
"""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.errors import DataError
from hdbench.importing.readers.rosmessage import RosMessage
from hdbench.importing.source import (
    PIECE_ROWS,
    Channel,
    Piece,
    Source,
    finite_or_nan,
    spelled,
    told_apart,
)

__all__ = ["open_file"]

_FORM = "ROS bag"
_NAMES = ("name", "names", "joint_names")
_STAMP = ("header/stamp/sec", "header/stamp/nanosec")
# units as the definitions of the messages state them (REP 103: SI)
_UNITS = {
    "sensor_msgs/msg/JointState": {"position": "rad", "velocity": "rad/s", "effort": "N m"},
    "sensor_msgs/msg/Temperature": {"temperature": "degC"},
}
_MOST_ELEMENTS = 512


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
        self.channels = told_apart(path, [channel for channel, _ in made])
        self._getters = {
            channel.name: getter for channel, (_, getter) in zip(self.channels, made, strict=True)
        }
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
