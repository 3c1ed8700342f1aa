"""Commands and their echoes: one at a time, each with its deadline."""

from __future__ import annotations

import time
from collections.abc import Callable

from hdbench.drivers.dataq.port import Port
from hdbench.errors import DeviceError

__all__ = ["Commands"]

_END = b"\r"
# an echo that was lost is asked for once more, each try within half of the deadline
_ATTEMPTS = 2
# after `stop` the line must have been quiet for this long, s
_QUIET_S = 0.03


class Commands:
    """Sends commands and checks what comes back.

    Parameters
    ----------
    port : Port
        The port; owned from now on.
    deadline_s : float
        Longest time of one command, s.
    clock : callable, optional
        Monotonic clock, s.

    Notes
    -----
    The instrument repeats every command, then a space and the value where there is one, then CR;
    only `start` is not repeated. A line that does not begin with the command is dropped: it belongs
    to an earlier one. All settings may be sent twice without harm.
    """

    def __init__(
        self, port: Port, *, deadline_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.where = f"DATAQ {port.where}"
        self.port = port
        self.dropped = 0
        self._deadline_s = deadline_s
        self._clock = clock

    def ask(self, command: str) -> str:
        """Send a command and return the value behind its echo; empty where there is none."""
        start_s = self._clock()
        for attempt in range(1, _ATTEMPTS + 1):
            until_s = start_s + self._deadline_s * attempt / _ATTEMPTS
            # what is still on its way belongs to an earlier command
            self.port.receive(0.0)
            self.port.send(command.encode() + _END, until_s)
            found = self._answer(command.encode(), until_s)
            if found is not None:
                return found
        raise self._error(f"{command!r} was not echoed", "check the instrument's cable and model")

    def set(self, command: str) -> None:
        """Send a setting; its echo must be the command and nothing else."""
        value = self.ask(command)
        if value:
            raise self._error(
                f"{command!r} was answered with {value[:40]!r}",
                "the instrument does not take this setting: compare it with its protocol",
            )

    def start(self) -> None:
        """Start scanning; sent once, never echoed."""
        self.port.receive(0.0)
        self.port.send(b"start 0" + _END, self._clock() + self._deadline_s)

    def stop(self) -> bytes:
        """Stop scanning and return the data that came before the echo."""
        until_s = self._clock() + self._deadline_s
        data = b""
        for attempt in range(1, _ATTEMPTS + 1):
            self.port.send(b"stop" + _END, until_s)
            half_s = until_s - self._deadline_s * (_ATTEMPTS - attempt) / _ATTEMPTS
            while self._clock() < half_s:
                quiet_s = min(half_s, self._clock() + _QUIET_S)
                chunks = self.port.receive(quiet_s)
                data += b"".join(chunk for chunk, _ in chunks)
                ended = data.rstrip(b"\n\0")
                if not chunks and ended.endswith(b"stop" + _END):
                    return ended.removesuffix(b"stop" + _END)
        raise self._error(
            "the instrument goes on after it was told to stop", "unplug it and plug it in again"
        )

    def close(self) -> None:
        """Close the port; never raises."""
        self.port.close()

    def _answer(self, command: bytes, until_s: float) -> str | None:
        """Return the value behind the echo of a command; None if it did not come in time."""
        data = b""
        while self._clock() < until_s:
            data += b"".join(chunk for chunk, _ in self.port.receive(until_s))
            *lines, data = data.split(_END)
            for line in lines:
                text = line.strip(b"\n\0 ")
                if text == command:
                    return ""
                if text.startswith(command + b" "):
                    value = text.removeprefix(command + b" ").decode("ascii", errors="replace")
                    return "".join(c for c in value if c.isprintable()).strip()
                self.dropped += 1
        return None

    def _error(self, what: str, fix: str) -> DeviceError:
        return DeviceError(f"{what} (deadline {self._deadline_s:g} s)", where=self.where, fix=fix)
