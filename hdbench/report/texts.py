"""Texts of the pages: files in the folder of templates, filled with numbers."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdbench.report.numbers import extra_lines, rounded_with, short, unit_words, with_std

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parent / "templates"


@cache
def _texts() -> Mapping[str, Any]:
    return tomllib.loads((TEMPLATES / "texts.toml").read_text(encoding="utf-8"))


def page_text(key: str, **numbers: object) -> str:
    """Return a text of the pages with its numbers."""
    return str(_texts()[key]).format_map(numbers)


def figure_texts(key: str, numbers: Mapping[str, object]) -> dict[str, str]:
    """Return title, caption and alternative text of a figure with their numbers."""
    return {name: text.format_map(numbers) for name, text in _texts()["figure"][key].items()}


@cache
def templates(*, autoescape: bool) -> Environment:
    """Return what fills templates; the numbers of a page are written by its filters."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=autoescape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters = (extra_lines, rounded_with, short, with_std)
    environment.filters |= {"unit": unit_words, **{f.__name__: f for f in filters}}
    return environment


def summary(kind: str, *values: object) -> str:
    """Return what a run, a comparison or a history says in plain words."""
    macros = templates(autoescape=False).get_template("summaries.j2").module
    return re.sub(r"\s*\n\s*", " ", str(getattr(macros, kind)(*values))).lstrip()
