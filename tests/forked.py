"""Processes that are forks of this one: what they import is loaded already."""

import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import pytest


def forked(act: Callable[[], object], **keys: Any) -> subprocess.Popen[Any]:
    """Start a process that acts and ends; `keys` are those of `Popen`."""

    def instead() -> None:
        """Run in place of the program that `Popen` would start, on its streams."""
        code = 70
        try:
            # the other end of the pipe by which `Popen` waits is among them
            os.closerange(3, os.sysconf("SC_OPEN_MAX"))
            os.environ.update(keys.get("env") or {})
            opened = partial(open, closefd=False)
            sys.stdin, sys.stdout, sys.stderr = map(opened, range(3), "rww")
            for signum in (signal.SIGTERM, signal.SIGHUP):
                signal.signal(signum, signal.SIG_DFL)
            signal.signal(signal.SIGINT, signal.default_int_handler)
            act()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except BaseException:  # noqa: BLE001 - as Python tells it at the end of a process
            sys.excepthook(*sys.exc_info())
        finally:
            # a reader that has gone hears nothing
            with suppress(OSError):
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(code)

    with warnings.catch_warnings():
        # the child goes on in one thread alone
        warnings.simplefilter("ignore", DeprecationWarning)
        return subprocess.Popen(["-"], preexec_fn=instead, restore_signals=False, **keys)


def hdbench_process(
    words: Sequence[object], *, terminal: bool = False, **keys: Any
) -> subprocess.Popen[Any]:
    """Start a command line; its streams may be a terminal that becomes its own."""
    command = [str(word) for word in words]
    keys = {"start_new_session": terminal, **keys}

    def take_terminal() -> None:
        import fcntl
        import termios

        if terminal:
            fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    if sys.platform != "linux":
        keys["env"] = {**os.environ, **keys.get("env", {})}
        own = {"preexec_fn": take_terminal} if terminal else {}
        return subprocess.Popen([sys.executable, "-m", "hdbench_cli", *command], **own, **keys)
    # what every run loads
    import_module("hdbench_cli.commands.experiment")
    main = import_module("hdbench_cli.main").main
    return forked(lambda: (take_terminal(), main(command)), **keys)


def ended(words: Sequence[object], **keys: Any) -> subprocess.CompletedProcess[str]:
    """Run another program to its end, for its exit code and what it said."""
    keys = {"timeout": 300.0, "text": True, **keys}
    return subprocess.run([*map(str, words)], capture_output=True, check=False, **keys)


@pytest.fixture(autouse=True, scope="module")
def warm_emulators() -> Iterator[None]:
    """Let emulators be forks, where a conftest takes this: a cold start takes a second."""
    process = import_module("hdbench.devices.emulator.process")

    def popen(words: Sequence[str], **keys: Any) -> subprocess.Popen[Any]:
        assert "hdbench.devices.emulator" in words[-1]
        import_module("hdbench.devices.emulator.serving")
        main = import_module("hdbench.devices.emulator.__main__").main
        return forked(lambda: sys.exit(main()), **keys)

    # elsewhere a fork may not use what is loaded, or there is none
    named = {**vars(subprocess), **({"Popen": popen} if sys.platform == "linux" else {})}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "subprocess", SimpleNamespace(**named))
        yield
