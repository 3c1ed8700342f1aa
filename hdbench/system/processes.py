"""Processes: who is who, how a child is kept from Ctrl-C, and how one is asked to end."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

DETACHED: dict[str, Any] = {"start_new_session": True}
"""Keywords of `subprocess.Popen` for a child that Ctrl-C and the end of the terminal miss."""
if sys.platform == "win32":
    # with a console of its own, which nobody sees: closing a console ends whatever is in it
    flags = subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW
    DETACHED = {"creationflags": flags}

# what ends a program from outside, where the system has it
_ENDING = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK", "SIGQUIT", "SIGTSTP", "SIGPIPE")


def process_mark(pid: int) -> str | None:
    """Return what tells a process from a later one with the same number."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(errors="replace")
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        # fields after the command in parentheses; the start tick is field 22 of all
        return f"{boot}:{stat.rpartition(')')[2].split()[19]}"
    except (OSError, IndexError):
        pass
    try:
        import psutil
    except ImportError:
        return None
    try:
        return f"{psutil.Process(pid).create_time():.3f}"
    except psutil.Error:
        return None


def process_exists(pid: int) -> bool:
    """Return whether there is a process of this number; True where that cannot be told."""
    if sys.platform == "win32":
        # there signal 0 is Ctrl-C
        import psutil

        return psutil.pid_exists(pid)
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def terminate(pid: int, mark: str) -> bool:
    """Send SIGTERM to the process of this number and mark; return whether it was sent.

    Notes
    -----
    The process is held by a descriptor first: its number cannot go to another one meanwhile. Only
    Linux has that.
    """
    if not hasattr(os, "pidfd_open"):
        return False
    try:
        process = os.pidfd_open(pid)
    except (OSError, ValueError):
        return False
    try:
        if not mark or mark != process_mark(pid):
            return False
        signal.pidfd_send_signal(process, signal.SIGTERM)
        # one that was stopped (SIGSTOP, a debugger) would hear of it only when it goes on
        signal.pidfd_send_signal(process, signal.SIGCONT)
    except OSError:
        return False
    finally:
        os.close(process)
    return True


def signal_self(signum: int) -> None:
    """Send this process a signal from any thread, as if another process had sent it."""
    if hasattr(signal, "pthread_kill"):
        # in the main thread it ends a wait, too
        signal.pthread_kill(threading.main_thread().ident or 0, signum)
    else:
        signal.raise_signal(signum)


def ignore_signals() -> None:
    """Let nothing that ends a program from outside end this one; a kill still does."""
    for name in _ENDING:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


def hold_name(name: str) -> contextlib.AbstractContextManager[object]:
    """Hold a name that one process of this computer can have, whoever its user is."""
    if sys.platform != "linux":
        return contextlib.nullcontext()
    held = socket.socket(socket.AF_UNIX)
    try:
        held.bind(f"\0{name}")
    except OSError:
        held.close()
        raise
    return held


@contextlib.contextmanager
def undisturbed(*names: str) -> Iterator[None]:
    """Hold signals back, where the system can: what is half done would be left behind."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.Signals[name] for name in names})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def kill(pid: int) -> None:
    """End a process of one's own at once."""
    os.kill(pid, getattr(signal, "SIGKILL", signal.SIGTERM))


def usable_cores() -> int:
    """Return how many processors this process may use; all where the system does not tell."""
    with contextlib.suppress(AttributeError):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
