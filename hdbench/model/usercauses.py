"""Causes of a user's own from several files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from hdbench.errors import DataError
from hdbench.model.declared import load_causes
from hdbench.model.definition import Cause
from hdbench.model.plugins import plugin_causes

__all__ = ["user_causes"]


def user_causes(paths: Iterable[Path]) -> tuple[Cause, ...]:
    """Return the causes of several causes files.

    Parameters
    ----------
    paths : iterable of Path
        TOML files as ``docs/causes.md`` describes them.

    Returns
    -------
    tuple of Cause
        In order of the files; hand them on as `BenchModel.with_extra`, or as `extra`.

    Raises
    ------
    DataError
        If a file is invalid, or a name stands in two files or in an installed package.
    """
    origin = {cause.name: "an installed package" for cause in plugin_causes()}
    found: list[Cause] = []
    for path in paths:
        for cause in load_causes(path):
            if cause.name in origin:
                raise DataError(
                    f"the cause {cause.name!r} stands in {origin[cause.name]} too; needed: a name "
                    "of its own",
                    where=str(path),
                    fix="rename one of the two",
                )
            origin[cause.name] = str(path)
            found.append(cause)
    return tuple(found)
