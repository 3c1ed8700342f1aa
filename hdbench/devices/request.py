"""A request to stop, from one process of a user to another: on every system, without a signal.

The process that holds a bench listens on a loopback port. Its lock file, which only its user can
read, tells port and a secret word; who says that word is told that it is the right process, or has
it end as upon SIGTERM.
"""

from __future__ import annotations

import secrets
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Literal

from hdbench.system.processes import signal_self

__all__ = ["Holder", "listening"]

_ANSWER_S = 1.0
_GRAIN_S = 0.2
_LONGEST = 64


@dataclass(frozen=True, slots=True)
class Holder:
    """The process that holds a bench, as its lock file tells; 0 and empty where it tells nothing.

    Parameters
    ----------
    pid : int
        Process number.
    mark : str
        As `hdbench.system.processes.process_mark` gives it; ``-`` where the system tells none.
    port : int
        Where it listens.
    secret : str
        What it is told.
    """

    pid: int = 0
    mark: str = ""
    port: int = 0
    secret: str = ""

    def ask(self, what: Literal["here", "stop"]) -> bool:
        """Ask whether it is there, or to end; return whether it said yes."""
        if not self.port:
            return False
        try:
            with socket.create_connection(("127.0.0.1", self.port), timeout=_ANSWER_S) as link:
                link.sendall(f"{what} {self.secret}\n".encode())
                return link.recv(_LONGEST) == b"yes\n"
        except OSError:
            return False


@contextmanager
def listening() -> Iterator[str]:
    """Take requests until the end of the block."""
    secret = secrets.token_hex(16)
    ended = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(_GRAIN_S)
        threading.Thread(target=_serve, args=(listener, secret, ended), daemon=True).start()
        try:
            yield f"{listener.getsockname()[1]} {secret}"
        finally:
            ended.set()


def _serve(listener: socket.socket, secret: str, ended: threading.Event) -> None:
    while not ended.is_set():
        try:
            link, _ = listener.accept()
        except TimeoutError:
            continue
        except OSError:
            # closed, or no descriptor left for a moment
            ended.wait(_GRAIN_S)
            continue
        with link, suppress(OSError):
            link.settimeout(_ANSWER_S)
            asked = link.recv(_LONGEST).decode("ascii", "replace").strip()
            what, _, said = asked.partition(" ")
            if secrets.compare_digest(said.encode(), secret.encode()) and what in ("here", "stop"):
                link.sendall(b"yes\n")
                if what == "stop" and not ended.is_set():
                    signal_self(signal.SIGTERM)
