"""The process in which libraries read foreign files: what crashes or asks for too much ends here.

It takes orders as lines of JSON on its standard input and answers each with the length of a head,
the head as JSON, and the arrays that the head describes (`ReaderProcess` is the other end).
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from mmap import mmap
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.errors import DataError
from hdbench.importing.source import Piece, Source, told
from hdbench.system.children import held_bytes, limit_memory, mapped

# beside what it holds at its start: with the process that asks, less than 500 MB
_MOST_BYTES = 280 << 20
# what no reader needs: a file that asks for it is not read
_REFUSED = ("socket.connect", "socket.getaddrinfo", "socket.sendto", "pickle.find_class")


@dataclass(slots=True)
class _Open:
    """A file that is read: its source, and the pieces that are left."""

    source: Source
    pieces: Iterator[Piece]
    memory: mmap | bytes = b""


# a head, and what follows it
_Answer = tuple[dict[str, Any], Sequence[bytes | memoryview]]


class _Server:
    def __init__(self) -> None:
        self._open: dict[int, _Open] = {}
        self._guarded = False

    def answer(self, order: Mapping[str, Any]) -> _Answer:
        """Do what is asked; errors of the file are answers too."""
        number = int(order["file"])
        try:
            match order["do"]:
                case "open":
                    return self._opened(number, order), ()
                case "pieces":
                    file = self._open[number]
                    file.pieces = file.source.pieces(order["names"])
                    file.memory = mapped(order["memory"])
                    return {}, ()
                case "next":
                    return self._next(number)
                case "place":
                    return {"place": self._open[number].source.place(int(order["row"]))}, ()
                case _:
                    self._open.pop(number).source.close()
                    return {}, ()
        except Exception as error:  # noqa: BLE001 - a library may raise anything on damaged bytes
            form = str(order["form"])
            return {"error": told(Path(order["path"]), form, error).to_dict()}, ()

    def _opened(self, number: int, order: Mapping[str, Any]) -> dict[str, Any]:
        try:
            importlib.import_module(order["library"])
            module = importlib.import_module(f"hdbench.importing.readers.{order['module']}")
        except ImportError:
            return {"missing": True}
        if not self._guarded:
            sys.addaudithook(_refuse)
            self._guarded = True
        source: Source = module.open_file(Path(order["path"]))
        self._open[number] = _Open(source, iter(()))
        return {
            "channels": [asdict(channel) for channel in source.channels],
            "notes": list(source.notes),
            "decimal_comma": source.decimal_comma,
        }

    def _next(self, number: int) -> _Answer:
        """Put numbers into the memory as far as it reaches; the rest and texts follow the head."""
        file = self._open[number]
        piece = next(file.pieces, None)
        if piece is None:
            return {"end": True}, ()
        kinds: list[tuple[str, int, int | None]] = []
        bodies: list[bytes | memoryview] = []
        at = 0
        for values in piece.values():
            if values.dtype == object:
                text = json.dumps(values.tolist()).encode()
                kinds.append(("text", len(text), None))
                bodies.append(text)
            elif at + values.nbytes <= len(file.memory):
                np.frombuffer(file.memory, values.dtype, len(values), at)[:] = values
                kinds.append((values.dtype.str, len(values), at))
                at += values.nbytes
            else:
                kinds.append((values.dtype.str, len(values), None))
                bodies.append(np.ascontiguousarray(values).data)
        return {"names": list(piece), "kinds": kinds}, bodies


def _refuse(event: str, _arguments: tuple[object, ...]) -> None:
    if event in _REFUSED:
        raise DataError(
            f"reading it asks for {event!r}; needed: a file that only holds data",
            where="the file",
            fix="do not use this file",
        )


def main() -> None:
    """Answer until nobody asks any more."""
    # the process that asks ends this one; Ctrl-C goes to both
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    orders, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    # what a library prints belongs to nobody
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    limit_memory(held_bytes() + _MOST_BYTES)
    server = _Server()
    for line in orders:
        head, bodies = server.answer(json.loads(line))
        text = json.dumps(head).encode()
        answers.writelines((len(text).to_bytes(8, "little"), text, *bodies))
        answers.flush()


if __name__ == "__main__":
    main()
