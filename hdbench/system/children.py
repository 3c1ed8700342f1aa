"""Children of hdbench: how one is started, and how much memory it may hold."""

from __future__ import annotations

import importlib
import mmap
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    import subprocess

# what a pipe of Linux holds; others keep their own size
_PIPE_BYTES = 1 << 20


def child_command(module: str) -> tuple[str, ...]:
    """Return the command that runs a module of hdbench in a process of its own.

    Notes
    -----
    ``python -m`` puts the folder it is called in before everything else, and ``PYTHONPATH`` comes
    before the standard library, so that a ``signal.py`` there would end the child. This process'
    module path is handed on behind the standard library instead, installed packages last.
    """
    # an empty entry is whatever folder the child is in
    paths = [os.path.abspath(path) for path in sys.path if path]
    program = (
        f"import sys; sys.path += {paths!r}; import runpy, site; site.main(); "
        f"runpy.run_module({module!r}, run_name='__main__', alter_sys=True)"
    )
    return (sys.executable, "-I", "-S", "-c", program)


class Fork:
    """A fork of this process that runs a module of hdbench; what of a `Popen` is used."""

    def __init__(self, pid: int, stdin: IO[bytes], stdout: IO[bytes]) -> None:
        self.pid, self.stdin, self.stdout = pid, stdin, stdout
        self._code: int | None = None

    def poll(self) -> int | None:
        """Return the exit code; None while it runs."""
        return self._waited(os.WNOHANG)

    def wait(self) -> int:
        """Wait for its end; return the exit code."""
        code = self._waited(0)
        return 0 if code is None else code

    def kill(self) -> None:
        """End it at once."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGKILL)

    def _waited(self, how: int) -> int | None:
        if self._code is None:
            ended, status = os.waitpid(self.pid, how)
            self._code = os.waitstatus_to_exitcode(status) if ended else None
        return self._code


def start_child(module: str, settings: Mapping[str, str]) -> Fork | subprocess.Popen[bytes]:
    """Start ``main()`` of a module in a process of its own, with pipes to 0 and from 1.

    Notes
    -----
    A fork has the libraries that are loaded here, and starts ten times as fast. Only Linux has one
    that is safe, and only while there is one thread: a lock that another holds would stay locked.
    """
    if sys.platform == "linux" and threading.active_count() == 1:
        return _fork(module, settings)
    import subprocess

    return subprocess.Popen(
        child_command(module),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **settings},
        pipesize=_PIPE_BYTES,
    )


def _fork(module: str, settings: Mapping[str, str]) -> Fork:
    import fcntl

    (orders, to), (back, answers) = os.pipe(), os.pipe()
    with suppress(OSError):  # a user may hold no more pipes of this size
        fcntl.fcntl(answers, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
    pid = os.fork()
    if pid:
        os.close(orders)
        os.close(answers)
        return Fork(pid, os.fdopen(to, "wb"), os.fdopen(back, "rb"))
    # nothing of the parent may run here: neither its handlers nor what it does at its end
    code = 1
    try:
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
            signal.signal(number, signal.SIG_DFL)
        os.dup2(orders, 0)
        os.dup2(answers, 1)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))
        os.environ.update(settings)
        importlib.import_module(module).main()
        code = 0
    finally:
        os._exit(code)


@contextmanager
def shared_memory(size: int) -> Iterator[tuple[mmap.mmap | bytes, str]]:
    """Hand out memory, and the path by which a child maps it too while this lasts.

    Both are empty where the system has no file that lies in memory only.
    """
    if sys.platform != "linux":
        yield b"", ""
        return
    with os.fdopen(os.memfd_create("hdbench"), "r+b") as file:
        file.truncate(size)
        yield mmap.mmap(file.fileno(), size), f"/proc/{os.getpid()}/fd/{file.fileno()}"


def mapped(path: str) -> mmap.mmap | bytes:
    """Return memory that another process shares; none where it cannot be reached."""
    try:
        with open(path, "r+b") as file:
            return mmap.mmap(file.fileno(), 0)
    except OSError:
        return b""


def held_bytes() -> int:
    """Return the memory that this process holds as Linux counts it; 0 elsewhere."""
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return 0
    found = [line.split()[1] for line in status.splitlines() if line.startswith("VmData:")]
    return 1024 * int(found[0]) if found else 0


def limit_memory(most_bytes: int) -> None:
    """Let this process hold no more memory than that, where the system has such a limit.

    Notes
    -----
    Linux counts what is mapped for writing; macOS only what ``brk`` gives, Windows nothing.
    """
    try:
        import resource
    except ImportError:
        return
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    least = most_bytes if hard == resource.RLIM_INFINITY else min(most_bytes, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (least, hard))
