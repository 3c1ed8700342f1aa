"""Names that a shell completes after an option; each is looked up when a tab is pressed."""

from __future__ import annotations

import click
from click.shell_completion import CompletionItem

__all__ = ["filter_models", "plants", "profiles"]

_Items = list[CompletionItem]


def _with_files(names: list[str], typed: str) -> _Items:
    """Return the names that begin as typed, and let the shell add its files."""
    found = [CompletionItem(name) for name in names if name.startswith(typed)]
    return [*found, CompletionItem(typed, type="file")]


def profiles(_ctx: click.Context, _param: click.Parameter, typed: str) -> _Items:
    """Complete a profile: built-in names and files."""
    from hdbench.profile import list_profiles

    return _with_files(list(list_profiles()), typed)


def plants(_ctx: click.Context, _param: click.Parameter, typed: str) -> _Items:
    """Complete a plant: built-in names and files."""
    from hdbench.plant.plantfile import list_plants

    return _with_files(list(list_plants()), typed)


def filter_models(_ctx: click.Context, _param: click.Parameter, typed: str) -> _Items:
    """Complete a filter model: presets, ``tuned`` and model files."""
    from hdbench.filter import PRESETS

    return _with_files([*PRESETS, "tuned"], typed)
