"""From a case of any part to its record."""

from .build import build, build_unseen
from .loadcases import build_loads
from .many import build_many
from .rough import build_pair

__all__ = ["make"]

_BUILDERS = {"L": build_loads, "T": build_many, "W": build_pair, "U": build_unseen}


def make(case):
    """Make the record of `case`."""
    return _BUILDERS.get(case.part, build)(case)
