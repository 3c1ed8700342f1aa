"""The emulator as a process of its own, started and stopped by the session that needs it."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from hdbench.errors import DeviceError, told_error
from hdbench.profile.schema import ProfileData
from hdbench.system.children import child_command
from hdbench.system.processes import DETACHED

if TYPE_CHECKING:
    from hdbench.devices.emulator.machine import Pace
    from hdbench.devices.emulator.server import Wire

# a cold start imports numpy and builds the plant; minutes only on a machine that is swamped
_START_S = 60.0
# the node gives its watchdog 3 s to stop the motor
_END_S = 5.0
_GRAIN_S = 0.05
_WHERE = "embedded bench"
# of what it said before it ended, bytes
_SAID = 4096
# one thread: the plant's small matrix products are slower in several
_THREADS = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


@contextmanager
def running_emulator(
    profile: ProfileData,
    *,
    plant: str,
    seed: int,
    pace: Pace,
    record: Path | None = None,
    wire: Wire = "tcp",
) -> Iterator[Mapping[str, Any]]:
    """Run an emulated node in a process of its own.

    Notes
    -----
    Ctrl-C does not reach the process. It ends by itself when this process does: its standard input
    ends, nobody is connected to its control channel any more, its watchdog stops the motor, it
    leaves.
    """
    order = {
        "profile": profile.model_dump_json(exclude_none=True),
        "plant": plant,
        "seed": seed,
        "pace": pace,
        "record": str(record) if record else None,
        "wire": wire,
    }
    with _kept_words() as words:
        process = subprocess.Popen(
            child_command("hdbench.devices.emulator"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=words,
            env={**os.environ, **_THREADS},
            **DETACHED,
        )
        try:
            yield _handshake(process, json.dumps(order).encode() + b"\n", words)
        finally:
            _end(process)


def _kept_words() -> IO[bytes]:
    """Return a file without a name for what a child says: unlike a pipe it is never full.

    A frozen session reads no pipe, and a child that is held up by one stops no motor.
    """
    try:
        return tempfile.TemporaryFile()
    except OSError:
        return open(os.devnull, "r+b")


def _handshake(process: subprocess.Popen[bytes], order: bytes, words: IO[bytes]) -> dict[str, Any]:
    """Hand the order over and return the emulator's one line of answer."""
    if process.stdin is None or process.stdout is None:
        raise DeviceError("no pipes to the emulator", where=_WHERE, fix="run again")
    # if it is gone already, the missing line below says so
    with suppress(BrokenPipeError):
        process.stdin.write(order)
        process.stdin.flush()
    line = _line(process.stdout.fileno(), _START_S)
    if not line.endswith(b"\n"):
        raise DeviceError(
            _why_not_started(process, words), where=_WHERE, fix="run `hdbench doctor`"
        )
    message: dict[str, Any] = json.loads(line)
    if "error" in message:
        raise told_error(message["error"])
    return message


def _why_not_started(process: subprocess.Popen[bytes], words: IO[bytes]) -> str:
    """Return what became of an emulator that said nothing."""
    try:
        code = process.wait(1.0)
    except subprocess.TimeoutExpired:
        return f"the emulator did not start within {_START_S:g} s"
    words.seek(max(0, words.seek(0, os.SEEK_END) - _SAID))
    last = words.read(_SAID).decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
    return f"the emulator ended with exit code {code}: {last[0]}"


def _line(descriptor: int, limit_s: float) -> bytes:
    """Return the first line of a pipe, or what has come of it; a thread waits for it."""
    line = bytearray()

    def read() -> None:
        with suppress(OSError):
            while not line.endswith(b"\n") and (chunk := os.read(descriptor, 4096)):
                line.extend(chunk)

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    until_s = time.monotonic() + limit_s
    while reader.is_alive() and time.monotonic() < until_s:
        # in short waits: on Windows Ctrl-C does not end a long one
        reader.join(_GRAIN_S)
    return bytes(line)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Close the lifeline and wait; a node that does not leave is killed."""
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            # closing flushes; perhaps nobody reads any more
            with suppress(BrokenPipeError):
                pipe.close()
    try:
        process.wait(_END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
