"""Which form of the filter runs: the C kernel, or its NumPy form."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache

from hdbench.errors import UsageError
from hdbench.filter import recursion

__all__ = ["Run", "kernel_name", "kernel_reason", "run_form"]

Run = Callable[..., int]
_VARIABLE = "HDBENCH_KERNEL"


@cache
def _compiled() -> tuple[Run | None, str]:
    try:
        from hdbench.filter import _kernel
    except ImportError:
        return None, "no C kernel was compiled at installation"
    return _kernel.run, "the C kernel was compiled at installation"


def _choose() -> tuple[str, str]:
    wanted = os.environ.get(_VARIABLE, "")
    if wanted not in ("", "c", "numpy"):
        raise UsageError(
            f"{_VARIABLE} is {wanted!r}; needed: c, numpy or nothing",
            where=f"environment variable {_VARIABLE}",
            fix=f"unset {_VARIABLE}",
        )
    if wanted == "numpy":
        return "numpy", f"{_VARIABLE}=numpy asks for it"
    function, reason = _compiled()
    if function is not None:
        return "c", reason
    if wanted == "c":
        raise UsageError(
            f"{_VARIABLE}=c, but {reason}",
            where=f"environment variable {_VARIABLE}",
            fix="install again where a C compiler is on PATH, or unset the variable",
        )
    return "numpy", reason


def kernel_name() -> str:
    """Return which form of the filter runs: ``c`` or ``numpy``.

    Returns
    -------
    str
        ``c`` for the compiled kernel, ``numpy`` for the form that needs no compiler. Both give the
        same numbers to rounding.

    Raises
    ------
    UsageError
        If the environment variable HDBENCH_KERNEL names no form, or one that is not there.
    """
    return _choose()[0]


def kernel_reason() -> str:
    """Return one line that says why `kernel_name` is what it is.

    Returns
    -------
    str
        The reason, without a full stop.

    Raises
    ------
    UsageError
        As `kernel_name`.
    """
    return _choose()[1]


def run_form(name: str) -> Run:
    """Return the function behind a form of the filter.

    Parameters
    ----------
    name : str
        ``c`` or ``numpy``, as `kernel_name` returns it.

    Returns
    -------
    callable
        `hdbench.filter.recursion.run` or its compiled twin.

    Raises
    ------
    ValueError
        If `name` is neither, or the compiled form is not there.
    """
    if name == "numpy":
        return recursion.run
    function, reason = _compiled()
    if name != "c" or function is None:
        raise ValueError(f"no filter form {name!r}: {reason}")
    return function
