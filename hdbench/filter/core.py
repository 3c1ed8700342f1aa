"""Which form of the kernel runs: compiled, or in Python with the same bits.

What they compute, with signatures, stands in `hdbench.filter.kalman`: ``run``, ``batch``,
``smooth`` on a `hdbench.filter.statespace.StateSpace`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Literal

from hdbench.errors import UsageError
from hdbench.filter import twin, twin_smooth

__all__ = ["Form", "KernelForm", "Run", "kernel_form", "kernel_name", "kernel_reason"]

Form = Literal["c", "numpy"]
Run = Callable[..., int]
_VARIABLE = "HDBENCH_KERNEL"


@dataclass(frozen=True, slots=True)
class KernelForm:
    """The entry points of one form.

    Parameters
    ----------
    run, batch, smooth : callable
        As in `hdbench.filter.twin` and `hdbench.filter.twin_smooth`.
    """

    run: Run
    batch: Run
    smooth: Run


def kernel_form(name: str) -> KernelForm:
    """Return the entry points of a form."""
    if name == "numpy":
        return KernelForm(twin.run, twin_smooth.batch, twin_smooth.smooth)
    form, reason = _compiled()
    if name != "c" or form is None:
        raise ValueError(f"no filter form {name!r}: {reason}")
    return form


@cache
def _compiled() -> tuple[KernelForm | None, str]:
    try:
        from hdbench.filter import _kernel
    except ImportError:
        return None, "no C kernel was compiled at installation"
    form = KernelForm(_kernel.run, _kernel.batch, _kernel.smooth)
    return form, "the C kernel was compiled at installation"


def _choose() -> tuple[Form, str]:
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


def kernel_name() -> Form:
    """Return which form of the filter runs: ``c`` or ``numpy``.

    Returns
    -------
    str
        ``c`` for the compiled kernel, ``numpy`` for the form that needs no compiler. Both give the
        same bits.

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
