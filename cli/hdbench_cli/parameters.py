"""Kinds of parameters that several commands take: stored paths, lists of speeds."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from hdbench.errors import nothing_stored

__all__ = ["StoredPath", "speeds"]


class StoredPath(click.Path):
    """Path of a stored file or run.

    Parameters
    ----------
    dir_okay : bool
        Whether a folder will do.

    Notes
    -----
    What is missing is invalid data (exit 4), as where a command finds it later on; a folder in
    place of a file stays wrong usage (exit 2).
    """

    def __init__(self, *, dir_okay: bool = True) -> None:
        super().__init__(path_type=Path, dir_okay=dir_okay, readable=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path, or say that nothing is there."""
        if not Path(value).exists():
            raise nothing_stored(value)
        return super().convert(value, param, ctx)


def speeds(ctx: click.Context, param: click.Parameter, typed: tuple[str, ...]) -> tuple[float, ...]:
    """Read motor velocities that are not zero; one option may name several, with commas between."""
    found = []
    for word in ",".join(typed).split(",") if typed else ():
        try:
            speed = float(word)
        except ValueError:
            speed = math.nan
        if not math.isfinite(speed) or speed == 0.0:
            raise click.BadParameter(
                f"{word!r}; needed: rad/s, finite and not 0, where orders have a frequency",
                ctx,
                param,
            )
        found.append(speed)
    return tuple(found)
