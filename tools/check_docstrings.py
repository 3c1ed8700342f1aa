"""Docstrings: numpydoc for what a room exports, a summary line for every other public name."""

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


# what a public name owes that only its own room uses
SUMMARY = {"GL08", "SS03", "SS06"}


def exported() -> set[int]:
    """Return the identity of every thing that a room, a folder of hdbench, exports."""
    things: set[int] = set()
    for info in pkgutil.iter_modules(hdbench.__path__, "hdbench."):
        if info.ispkg:
            room = importlib.import_module(info.name)
            things |= {id(getattr(room, name)) for name in getattr(room, "__all__", ())}
    return things


def public_names() -> Iterator[tuple[str, object]]:
    """Yield the dotted name of every public function and class, and the thing itself."""
    for info in pkgutil.walk_packages(hdbench.__path__, "hdbench."):
        if info.name.endswith(("__main__", "_kernel")):
            continue
        module = importlib.import_module(info.name)
        for name, thing in sorted(vars(module).items()):
            # a function that another one made carries the maker's name
            made_here = f"{getattr(thing, '__module__', '')}.{getattr(thing, '__name__', '')}"
            whole_name = f"{info.name}.{name}"
            if made_here == whole_name and not name.startswith("_") and _has_parameters(thing):
                yield whole_name, thing


def _has_parameters(thing: object) -> bool:
    """Say whether a docstring owes parameters.

    A Protocol, an Enum, a table of a schema and an error without a constructor of its own do not.
    """
    if inspect.isclass(thing):
        inherits = issubclass(thing, Exception) and "__init__" not in vars(thing)
        known = issubclass(thing, Enum | BaseModel) or getattr(thing, "_is_protocol", False)
        # the fields of a result carry their meaning themselves
        known = known or hasattr(thing, "__pydantic_fields__")
        return not (inherits or known)
    return inspect.isfunction(thing)


def _has_summary(thing: object) -> bool:
    """Say whether a docstring has a summary of one line with a full stop: numpydoc looks slowly."""
    # one that is inherited is no docstring of this thing
    first, *more = inspect.cleandoc(thing.__doc__ or "").splitlines() or [""]
    return first.endswith(".") and not any(more[:1])


def main() -> int:
    """Print what is wrong; return 1 if anything is."""
    found, rooms = 0, exported()
    for name, thing in public_names():
        owed = CODES if id(thing) in rooms else SUMMARY
        if owed is SUMMARY and _has_summary(thing):
            continue
        for code, message in validate(name)["errors"]:
            if code in owed:
                found += 1
                print(f"{name}: {code} {message}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
