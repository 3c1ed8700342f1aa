"""Hide from hdbench what Windows does not have; the libraries below it keep theirs.

Run before anything else in a process, with ``__file__`` set; it hands itself on to every child
that hdbench starts. What is hidden: modules, functions of `os`, `select` and `socket`, signals,
readers of an event loop, `select` on anything but a socket, and descriptors handed to children.
"""

from __future__ import annotations

import asyncio
import asyncio.selector_events
import builtins
import importlib
import os
import select
import selectors  # noqa: F401 - it keeps what is hidden below
import signal
import socket
import subprocess
import sys
from typing import Any

OWN = {"hdbench", "hdbench_cli", "process", "__main__"}
MODULES = {"fcntl", "grp", "posix", "pty", "pwd", "resource", "selectors", "termios", "tty"}
FUNCTIONS: dict[Any, str] = {
    os: "fdatasync fork forkpty getegid geteuid getgid getuid killpg openpty pidfd_open "
    "posix_fallocate set_blocking setsid ttyname O_CLOEXEC O_NOCTTY O_NOFOLLOW",
    select: "epoll poll POLLERR POLLHUP POLLIN POLLOUT PIPE_BUF",
    signal: "SIGALRM SIGCONT SIGHUP SIGQUIT SIGSTOP SIGTSTP SIGUSR1 SIGUSR2 alarm "
    "pidfd_send_signal pthread_kill setitimer",
    socket: "MSG_DONTWAIT",
}
THIS = globals()["__file__"]
BEFORE = (
    f"exec(compile(open({THIS!r}).read(), {THIS!r}, 'exec'), "
    f"{{'__name__': 'hiding', '__file__': {THIS!r}}})\n"
)


def _is_own(names: Any) -> bool:
    return str((names or {}).get("__name__", "")).partition(".")[0] in OWN


def _hide_modules() -> None:
    shown, found = builtins.__import__, importlib.import_module

    def load(name: str, names: Any = None, *rest: Any, **keys: Any) -> Any:
        if name.partition(".")[0] in MODULES and _is_own(names):
            raise ImportError(f"{name} is hidden", name=name)
        return shown(name, names, *rest, **keys)

    def load_by_name(name: str, package: str | None = None) -> Any:
        if name in MODULES and _is_own(sys._getframe(1).f_globals):  # noqa: SLF001
            raise ImportError(f"{name} is hidden", name=name)
        return found(name, package)

    builtins.__import__ = load
    importlib.import_module = load_by_name


def _hide_functions() -> None:
    for module, names in FUNCTIONS.items():
        for name in names.split():
            if hasattr(module, name):
                delattr(module, name)

    def refused(*_: Any) -> None:
        raise NotImplementedError("hidden")

    loop = asyncio.selector_events.BaseSelectorEventLoop
    loop.add_reader = loop.add_writer = refused  # type: ignore[method-assign,assignment]
    asyncio.SelectorEventLoop.add_signal_handler = refused  # type: ignore[method-assign,assignment]


def _hide_select() -> None:
    shown = select.select

    def sockets_only(*given: Any) -> Any:
        if _is_own(sys._getframe(1).f_globals):  # noqa: SLF001
            for one in (one for part in given[:3] for one in part):
                if not isinstance(one, socket.socket):
                    raise OSError(10038, "an operation was attempted on something not a socket")
        return shown(*given)

    select.select = sockets_only


def _hand_on() -> None:
    start = subprocess.Popen.__init__

    def hidden(self: Any, command: Any, *rest: Any, **keys: Any) -> None:
        if keys.get("pass_fds") or keys.get("preexec_fn"):
            raise ValueError("descriptors and functions cannot be handed to a child: hidden")
        if not isinstance(command, str) and command[0] == sys.executable and "-c" in command:
            command = list(command)
            at = command.index("-c") + 1
            if "'hiding'" not in command[at]:
                command[at] = BEFORE + command[at]
        start(self, command, *rest, **keys)

    subprocess.Popen.__init__ = hidden  # type: ignore[method-assign]


_hide_modules()
_hide_functions()
_hide_select()
_hand_on()
