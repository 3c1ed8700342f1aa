"""Validate the docstring of every public name of the library with numpydoc."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import sys
from collections.abc import Iterator
from enum import Enum

from numpydoc.validate import validate
from pydantic import BaseModel

import hdbench

# GL08 no docstring, SS03/SS05/SS06 summary line, PR01-PR04 parameters, RT01 returns, YD01 yields
CODES = {"GL08", "SS03", "SS06", "PR01", "PR02", "PR03", "PR04", "RT01", "YD01"}


def public_names() -> Iterator[str]:
    """Yield the dotted name of every public function and class."""
    for info in pkgutil.walk_packages(hdbench.__path__, "hdbench."):
        if info.name.endswith(("__main__", "_kernel", "_recursions")):
            continue
        module = importlib.import_module(info.name)
        for name in getattr(module, "__all__", ()):
            thing = getattr(module, name)
            if getattr(thing, "__module__", None) == info.name and _has_parameters(thing):
                yield f"{info.name}.{name}"


def _has_parameters(thing: object) -> bool:
    """Say whether a docstring owes parameters.

    A Protocol, an Enum, a table of a schema and an error without a constructor of its own do not.
    """
    if inspect.isclass(thing):
        inherits = issubclass(thing, Exception) and "__init__" not in vars(thing)
        known = issubclass(thing, Enum | BaseModel) or getattr(thing, "_is_protocol", False)
        return not (inherits or known)
    return inspect.isfunction(thing)


def main() -> int:
    """Print what is wrong; return 1 if anything is."""
    found = 0
    for name in public_names():
        for code, message in validate(name)["errors"]:
            if code in CODES:
                found += 1
                print(f"{name}: {code} {message}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
