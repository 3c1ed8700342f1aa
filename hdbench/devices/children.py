"""Python programs of hdbench as children: the standard library before any folder of the user."""

from __future__ import annotations

import os
import sys

__all__ = ["child_command"]


def child_command(module: str) -> tuple[str, ...]:
    """Return the command that runs a module of hdbench in a process of its own.

    Parameters
    ----------
    module : str
        Its full name.

    Returns
    -------
    tuple of str

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
