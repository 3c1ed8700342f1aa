"""A command line in a fork of this process: what it imports is loaded already."""

from __future__ import annotations

import fcntl
import os
import signal
import sys
import termios
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

_NOTHING = Path(os.devnull)


@dataclass
class Forked:
    """A command in a process of its own, and the file in which its stderr is kept."""

    pid: int
    said: Path
    code: int | None = None

    def poll(self) -> int | None:
        """Return the exit code once there is one."""
        if self.code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.code = os.waitstatus_to_exitcode(status) if pid else None
        return self.code

    def wait(self, seconds: float = 60.0) -> int:
        """Return the exit code, which has to come in time."""
        until = time.monotonic() + seconds
        while self.poll() is None:
            assert time.monotonic() < until, f"does not end: {self.text}"
            time.sleep(0.01)
        return self.code

    def send(self, signum: int) -> None:
        """Send a signal to a process that has not ended."""
        if self.poll() is None:
            os.kill(self.pid, signum)

    @property
    def text(self) -> str:
        """What it said on stderr."""
        return self.said.read_text(errors="replace")


def fork(
    words: Sequence[object],
    *,
    said: Path = _NOTHING,
    stdin: int | None = None,
    stdout: int | None = None,
    terminal: int | None = None,
    **environment: str,
) -> Forked:
    """Start a command on these streams, or on a terminal that becomes its own."""
    # what every run loads
    import_module("hdbench_cli.commands.experiment")
    main = import_module("hdbench_cli.main").main
    with warnings.catch_warnings():
        # the child goes on in one thread alone
        warnings.simplefilter("ignore", DeprecationWarning)
        pid = os.fork()
    if pid:
        return Forked(pid, said)
    code = 70
    try:
        if terminal is None:
            nothing = os.open(os.devnull, os.O_RDWR)
            stderr = os.open(said, os.O_WRONLY | os.O_CREAT, 0o644)
            streams = [nothing if one is None else one for one in (stdin, stdout)] + [stderr]
        else:
            streams = [terminal] * 3
        os.environ.update(environment)
        _use(streams, owned=terminal is not None)
        main([str(word) for word in words])
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:  # noqa: BLE001 - as Python tells it at the end of a process
        sys.excepthook(*sys.exc_info())
    finally:
        os._exit(code)


def _use(streams: Sequence[int], *, owned: bool) -> None:
    """Take these descriptors for the standard streams, close the others, hear every signal."""
    os.setsid()
    for number, descriptor in enumerate(streams):
        os.dup2(descriptor, number)
    if owned:
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    os.closerange(3, os.sysconf("SC_OPEN_MAX"))
    sys.stdin, sys.stdout, sys.stderr = map(os.fdopen, range(3), "rww")
    for signum in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(signum, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
