"""Children of hdbench: how one is started, and how much memory it may hold."""

from __future__ import annotations

import os
import sys


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
